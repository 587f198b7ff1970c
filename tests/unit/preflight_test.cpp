// What a render counts on of memory, beside what it then takes.
#include "src/session/preflight.h"

#include <gtest/gtest.h>

#include "src/frame/look_image.h"
#include "src/session/session.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

Scene room(float emission) {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, emission)};
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
  return scene;
}

RenderSettings settings(bool dial) {
  RenderSettings s;
  s.width = 1280;
  s.height = 720;
  s.dial = dial;
  s.exact = dial ? kFirstShare : 0.0;
  s.denoise = Denoise::kFilter;
  s.device = RenderSettings::kNoDevice;
  return s;
}

std::uint64_t bytesOf(const Scene& scene, const RenderSettings& s) {
  for (const Preflight::Phase& phase : preflight(scene, s, {}).phases) {
    if (phase.name == "rendering") return phase.bytes;
  }
  return 0;
}

/// More than `s` needs, in bytes; what the process has at the time may change by a little.
void expectMore(std::uint64_t bytes, std::uint64_t than, std::uint64_t by) {
  constexpr std::uint64_t kAbout = 4u << 20;
  EXPECT_GT(bytes + kAbout, than + by);
  EXPECT_LT(bytes, than + by + kAbout);
}

TEST(Preflight, CountsTheLooksAndThePreviewOfTheViewer) {
  const Scene scene = room(8.0f);
  RenderSettings viewer = settings(false);
  const std::uint64_t capture = bytesOf(scene, viewer);
  viewer.interactive = true;
  const std::uint64_t frame = Accumulator::bytesNeeded(viewer.width, viewer.height, false) +
                              FeatureImage::bytesNeeded(viewer.width, viewer.height);
  expectMore(bytesOf(scene, viewer), capture,
             frame + LookImage::bytesNeeded(viewer.width, viewer.height));
}

TEST(Preflight, PairsAreOfModelsWithLight) {
  const std::uint64_t pixels = 1280 * 720;
  const Scene lit = room(8.0f), dark = room(0.0f);
  const std::uint64_t pairs =
      Accumulator::bytesNeeded(1280, 720, true) - Accumulator::bytesNeeded(1280, 720, false);
  EXPECT_EQ(pairs, 104 * pixels);
  const std::uint64_t litMore = bytesOf(lit, settings(true)) - bytesOf(lit, settings(false));
  const std::uint64_t darkMore = bytesOf(dark, settings(true)) - bytesOf(dark, settings(false));
  EXPECT_GT(litMore, pairs + 32 * pixels);
  EXPECT_LT(darkMore + pairs, litMore);
}

TEST(Preflight, SessionsWithoutGuessesKeepNoPairs) {
  RenderSettings s = settings(true);
  s.width = s.height = 16;
  s.samples = 4;
  for (const bool voxels : {false, true}) {
    const auto model =
        std::make_shared<const Model>(makeModel(room(8.0f), {.voxels = voxels, .voxelDepth = 4}));
    Session r(model, model->scene.cameras.front(), s);
    EXPECT_EQ(r.buffers().sums.keepsPairs(), voxels);
    r.run();
    EXPECT_EQ(r.samplesDone(), 4u);
    for (const float v : r.picture().values) EXPECT_TRUE(std::isfinite(v));
  }
}

}  // namespace
}  // namespace trex
