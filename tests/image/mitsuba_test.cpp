// Mitsuba scenes against pictures of Mitsuba itself, of the same XML (refs/mitsuba-*.exr, made by
// make_mitsuba_refs.py).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "src/scene/import.h"
#include "tests/image/reference.h"
#include "tests/image/rendered.h"

namespace trex::test {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kSide = 64;

/// The references have paths of any length, whatever the files say.
Rendered renderXml(const fs::path& path, std::uint32_t samples) {
  return render(importScene(path, {.maxBounces = Scene::kAnyBounces}),
                settingsFor(kSide, 1.0, samples));
}

fs::path ownScene(const std::string& name) {
  return fs::path(TREX_SOURCE_DIR) / "tests/image/mitsuba" / (name + ".xml");
}

/// Means by channel agree within `share` of the reference's, and three deviations of the noise.
void expectMeans(const std::string& name, const Rendered& image, const Rendered& reference,
                 double share) {
  for (int c = 0; c < 3; ++c) {
    const double noise = 3.0 * std::sqrt(image.totalVariance[c] + reference.totalVariance[c]);
    const double limit = share + noise / reference.total[c];
    const double bias = image.total[c] / reference.total[c] - 1.0;
    report(fmt::format("{} mean of channel {}", name, c), bias, limit);
    EXPECT_NEAR(bias, 0.0, limit) << name << ", channel " << c;
  }
  if (testing::Test::HasFailure()) keepArtefacts(name, image, reference);
}

/// What a material here can say: no difference but noise, and where spheres are polyhedra: a few
/// pixels of their rims and of what glass shows.
TEST(MitsubaImage, ExactPartsPassTheZTest) {
  for (const char* name : {"mitsuba-exact", "mitsuba-lights"}) {
    const Rendered reference = readReference(name), image = renderXml(ownScene(name), 512);
    const Comparison result = compare(image, reference);
    report(fmt::format("{} pixels failed", name), 1.0 - result.pixelsPassed, 0.01);
    EXPECT_GE(result.pixelsPassed, 0.99) << name;
    if (HasFailure()) keepArtefacts(name, image, reference);
    expectMeans(name, image, reference, 0.002);
  }
}

/// Metals, plastics and Disney's lobes: the means stay.
TEST(MitsubaImage, ApproximatedPartsKeepTheMean) {
  const Rendered reference = readReference("mitsuba-alike");
  const Rendered image = renderXml(ownScene("mitsuba-alike"), 256);
  const Comparison result = compare(image, reference);
  report("mitsuba-alike worst block", result.worstBlock, 0.1);
  EXPECT_LT(result.worstBlock, 0.1);
  expectMeans("mitsuba-alike", image, reference, 0.01);
}

/// The originals of the shared interiors.
TEST(MitsubaImage, OriginalsKeepTheMean) {
  const char* given = std::getenv("TREX_SHARED");
  const fs::path folder = fs::path(given != nullptr ? given : "") / "scenes/mitsuba";
  if (given == nullptr || !fs::is_directory(folder)) {
    GTEST_SKIP() << "no shared scenes; set TREX_SHARED to their folder";
  }
  for (const char* name : {"staircase2", "veach-bidir", "veach-ajar"}) {
    const Rendered reference = readReference(fmt::format("mitsuba-{}", name));
    expectMeans(name, renderXml(folder / name / "scene.xml", 128), reference, 0.01);
  }
}

}  // namespace
}  // namespace trex::test
