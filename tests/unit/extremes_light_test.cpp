// Extremes of light and material: radiance, roughness, white furnaces; and of length: a million
// frames. docs/tests.md has the numbers.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <random>

#include "src/frame/accumulator.h"
#include "tests/image/rendered.h"
#include "tests/unit/scenes.h"

namespace trex::test {
namespace {

// --- Radiance from 1e-8 to 1e8 in one frame

/// A cell of 1 x 1 x 2 m, open towards +z, whose back wall glows; its left wall is at x.
void addCell(Scene& scene, float x, float radiance) {
  const int walls = static_cast<int>(scene.materials.size());
  scene.materials.push_back(lambert(0.5f));
  scene.materials.push_back(lambert(0.5f, radiance));
  Mesh cell = box(vec3(x, -0.5f, -2.0f), vec3(x + 1.0f, 0.5f, 0.0f), walls, true);
  // Triangles 8 and 9 are the back, 10 and 11 the front.
  cell.triangles.resize(10);
  Mesh glow = cell;
  glow.material = walls + 1;
  glow.triangles.erase(glow.triangles.begin(), glow.triangles.begin() + 8);
  cell.triangles.resize(8);
  place(scene, cell);
  place(scene, glow);
}

/// Two cells beside each other; no light of one reaches the other.
Scene cells(float left, float right) {
  Scene scene;
  addCell(scene, -1.01f, left);
  addCell(scene, 0.01f, right);
  Camera camera;  // upright, so that the halves of the picture are the cells
  camera.eye = dvec3(0.0, 0.0, 2.0);
  camera.verticalFov = 0.6f;
  scene.cameras = {camera};
  return scene;
}

/// Mean of the picture's left or right half.
double half(const Rendered& image, bool right) {
  double sum = 0.0;
  for (std::uint32_t y = 0; y < image.height; ++y) {
    for (std::uint32_t x = 0; x < image.width; ++x) {
      if ((x >= image.width / 2) == right) sum += image.mean[std::size_t{y} * image.width + x].y;
    }
  }
  return 2.0 * sum / static_cast<double>(image.mean.size());
}

/// Both cells are right in the exact mode. The guess is right in the bright one; in the dim one the
/// little that leaks through the voxels of the wall between outshines sixteen decades less.
TEST(Radiance, SixteenDecadesInOneFrame) {
  for (double exact : {1.0, 0.0}) {
    const RenderSettings settings = settingsFor(64, exact, 256);
    const Rendered even = render(cells(1.0f, 1.0f), settings);
    const Rendered image = render(cells(1e8f, 1e-8f), settings);
    const double bright = half(image, false) / half(even, false) / 1e8 - 1.0;
    report(fmt::format("radiance 1e8 beside 1e-8, exact {}, error", exact), bright, 0.01);
    EXPECT_NEAR(bright, 0.0, 0.01);
    if (exact == 1.0) {
      const double dim = half(image, true) / half(even, true) / 1e-8 - 1.0;
      report(fmt::format("radiance 1e-8 beside 1e8, exact {}, error", exact), dim, 0.01);
      EXPECT_NEAR(dim, 0.0, 0.01);
    } else {
      const double leak = half(image, true) / half(image, false);
      report("radiance 1e-8 beside 1e8, guess, leak over the bright cell", leak, 0.001);
      EXPECT_LT(leak, 0.001);
    }
    if (HasFailure()) keepArtefact("radiance", image);
  }
}

// --- Roughness 0 and 1

/// A white plate that fills the picture, seen from the front, in a sky of 1.
Rendered renderPlate(const Material& material, double exact) {
  Scene scene;
  scene.materials = {material};
  place(scene, box(vec3(-1.0f, -1.0f, -1.0f), vec3(1.0f, 1.0f, 0.0f), 0, false));
  scene.environment.color = vec3(1.0f);
  Camera camera;
  camera.eye = dvec3(0.0, 0.0, 4.0);
  camera.verticalFov = 0.02f;
  scene.cameras = {camera};
  return render(scene, settingsFor(32, exact, 512));
}

/// What the plate shows is its albedo along the normal. That of a rough metal is what one
/// scattering by GGX facets of alpha 1 leaves: 0.3072, integrated numerically apart from this
/// program.
TEST(Roughness, ZeroAndOneAreRight) {
  struct Row {
    const char* name;
    float metallic, transmission, roughness;
    double least, most;
  };
  for (const Row& row : {Row{"metal", 1.0f, 0.0f, 0.0f, 0.9999, 1.0001},
                         {"metal", 1.0f, 0.0f, 1.0f, 0.3052, 0.3092},
                         {"coat", 0.0f, 0.0f, 0.0f, 0.99, 1.002},
                         {"coat", 0.0f, 0.0f, 1.0f, 0.95, 1.002},
                         {"glass", 0.0f, 1.0f, 0.0f, 0.99, 1.002},
                         {"glass", 0.0f, 1.0f, 1.0f, 0.2, 1.002}}) {
    Material m;
    m.metallic = row.metallic;
    m.roughness = row.roughness;
    m.transmission = row.transmission;
    m.volume = row.transmission > 0.0f;
    for (double exact : {1.0, 0.0}) {
      const Rendered image = renderPlate(m, exact);
      report(fmt::format("{} of roughness {}, exact {}, radiance in a sky of 1", row.name,
                         row.roughness, exact),
             image.total.y, row.least);
      EXPECT_GE(image.total.y, row.least) << row.name << row.roughness;
      EXPECT_LE(image.total.y, row.most) << row.name << row.roughness;
    }
  }
}

// --- White walls

/// Nothing is absorbed, so light grows without end; paths still end.
TEST(WhiteFurnace, Terminates) {
  Scene scene = furnace(1.0f);
  scene.materials[0].emission = vec3(1e-3f);
  for (double exact : {1.0, 0.0}) {
    const Rendered image = render(scene, settingsFor(8, exact, 4));
    report(fmt::format("white furnace exact {}, radiance over emission", exact),
           image.total.y / 1e-3, kInfinity);
    EXPECT_GT(image.total.y / 1e-3, 16.0);
    EXPECT_TRUE(std::isfinite(image.total.y));
  }
}

// --- A million frames

TEST(MillionFrames, MeansStayExact) {
  constexpr std::uint32_t kFrames = 1'000'000;
  Accumulator frame(1, 1, true);
  std::mt19937 random(3);
  long double sum = 0.0L, sumExact = 0.0L;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    const float guess = static_cast<float>(random()) * 0x1p-32f;
    // Rare bright samples make the sums' parts differ by eight decades.
    const float value = i % 1000 == 0 ? 1e5f * guess : 1e-3f * guess;
    const vec3 exact(2.0f * value + 0.25f);
    frame.add(0, 0, i, vec3(value), &exact);
    sum += static_cast<long double>(value);
    sumExact += static_cast<long double>(exact.x - value);
  }
  const long double mean = (sum + sumExact) / kFrames;
  const double error =
      std::abs(static_cast<double>(static_cast<long double>(frame.mean(0, 0).x) / mean - 1.0L));
  report("million frames, relative error of the mean", error, 1e-9);
  EXPECT_LT(error, 1e-9);
  EXPECT_EQ(frame.samples(0, 0), kFrames);
}

TEST(MillionFrames, OfAPictureOfOnePixel) {
  Scene scene = furnace(0.5f);
  scene.materials[0].emission = vec3(0.5f);
  const Rendered image = render(scene, settingsFor(1, 1.0, TREX_LONG_FRAMES));
  report("long picture of one pixel, error", image.total.y - 1.0, 0.004);
  EXPECT_EQ(image.report.samplesDone, std::uint32_t{TREX_LONG_FRAMES});
  EXPECT_NEAR(image.total.y, 1.0, 0.004);
}

}  // namespace
}  // namespace trex::test
