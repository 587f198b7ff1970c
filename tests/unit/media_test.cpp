// Media against closed forms, and at the extremes.
#include "src/crays/media.h"

#include <gtest/gtest.h>

#include <limits>

#include "asvo/asvo.h"
#include "asvo/medium.h"
#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// A cube of 16^3 voxels of one density; its trilinear edge is half a voxel inside and outside.
asvo::Medium cube(float density, const vec3* emission = nullptr) {
  const std::vector<float> values(512, density);
  const std::vector<vec3> emissions(512, emission ? *emission : vec3(0.0f));
  std::vector<asvo::MediumLeaf> leaves(8);
  for (int i = 0; i < 8; ++i) {
    leaves[i].origin = 8 * glm::ivec3(i >> 2, i >> 1 & 1, i & 1);
    leaves[i].values = values;
    if (emission) leaves[i].emissions = emissions;
  }
  return asvo::Medium::build(leaves);
}

/// The cube over [-1, 1]^3 times `scale`.
Medium placed(asvo::Medium grid, double scale = 1.0, const dvec3& centre = dvec3(0.0)) {
  Medium m;
  m.grid = std::make_shared<const asvo::Medium>(std::move(grid));
  for (int axis = 0; axis < 3; ++axis) m.transform[axis][axis] = scale * 0.125;
  m.transform[3] = glm::dvec4(centre - scale * 0.9375, 1.0);
  return m;
}

std::unique_ptr<const Media> mediaOf(Medium m, const dvec3& origin = dvec3(0.0)) {
  Scene scene;
  scene.media.push_back(std::move(m));
  return Media::make(scene, origin);
}

TEST(Media, TransmittanceIsThatOfBeerAndLambert) {
  for (const float density : {0.0f, 1e-8f, 0.3f, 5.0f, 1e8f}) {
    const auto media = mediaOf(placed(cube(1.0f)));
    Medium m = placed(cube(1.0f));
    m.density = density;
    m.emission = vec3(1.0f);
    const auto scaled = mediaOf(std::move(m));
    // The ramps of the edges have the integral of a sharp edge.
    const float passed = scaled->transmittance(vec3(-3, 0, 0), vec3(1, 0, 0), kInfinity);
    EXPECT_NEAR(passed, std::exp(-2.0f * density), 1e-5f) << density;
    EXPECT_NEAR(media->transmittance(vec3(0.0f), vec3(0, 1, 0), 0.5f), std::exp(-0.5f), 1e-5f);
  }
}

TEST(Media, ScaleAndPlaceDoNotMatter) {
  for (const double scale : {1e-6, 1.0, 1e6}) {
    for (const dvec3& centre : {dvec3(0.0), dvec3(5e6, -5e6, 5e6)}) {
      Medium m = placed(cube(1.0f), scale, centre);
      m.density = static_cast<float>(1.0 / scale);
      const auto media = mediaOf(std::move(m), centre);
      const auto far = static_cast<float>(scale);
      const vec3 way = glm::normalize(vec3(1.0f, 0.3f, 0.2f));
      const float passed = media->transmittance(-1000.0f * far * way, way, kInfinity);
      EXPECT_NEAR(passed, std::exp(-2.0f / way.x), 2e-4f) << scale << " " << centre.x;
    }
  }
}

TEST(Media, EmissionIsItsIntegral) {
  const vec3 glow(1.0f, 2.0f, 4.0f);
  for (const float density : {0.0f, 1e-8f, 1.0f, 1e4f}) {
    Medium grid = placed(cube(1.0f, &glow)), even = placed(cube(1.0f));
    grid.density = even.density = density;
    grid.emission = vec3(1.0f);
    even.emission = glow;
    for (Medium* m : {&grid, &even}) {
      Sampler sampler(1, 2, 3);
      const auto media = mediaOf(*m);
      const MediaStretch s = media->stretch(vec3(0, 0, -3), vec3(0, 0, 1), kInfinity, sampler);
      const float expected = density > 0.0f ? -std::expm1(-2.0f * density) / density : 2.0f;
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(s.emission[c], glow[c] * expected, 0.01f * glow[c] * expected) << density;
      }
    }
  }
}

TEST(Media, PlacesOfScatteringFollowTransmittance) {
  Medium m = placed(cube(1.0f));
  m.density = 1.5f;
  const auto media = mediaOf(std::move(m));
  // Mean depth of exp(-1.5 x) on [0, 2].
  const double a = 1.5, expected = 1.0 / a - 2.0 / std::expm1(2.0 * a);
  double sum = 0.0;
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    Sampler sampler(7, static_cast<std::uint32_t>(i), 0);
    sum += media->stretch(vec3(-3, 0, 0), vec3(1, 0, 0), kInfinity, sampler).distance - 2.0;
  }
  EXPECT_NEAR(sum / kCount, expected, 0.01);
}

TEST(Media, PhaseFunctionIsNormalisedAndSampled) {
  for (const float g : {-0.9f, 0.0f, 0.5f, 0.95f}) {
    double integral = 0.0, cosine = 0.0;
    constexpr int kSteps = 20000;
    for (int i = 0; i < kSteps; ++i) {
      const float mu = -1.0f + 2.0f * (static_cast<float>(i) + 0.5f) / kSteps;
      integral += static_cast<double>(henyeyGreenstein(mu, g)) * 4.0 * std::numbers::pi / kSteps;
    }
    EXPECT_NEAR(integral, 1.0, 1e-3) << g;
    for (std::uint32_t i = 0; i < 4096; ++i) {
      Sampler sampler(3, i, 0);
      cosine += static_cast<double>(sampleHenyeyGreenstein(vec3(0, 0, 1), g, sampler.next2D()).z);
    }
    EXPECT_NEAR(cosine / 4096.0, g, 0.01) << g;
  }
}

/// Thin white fog in even light can't be seen: what it takes it gives back, but for light that
/// would be scattered twice, which is less than the square of the optical depth.
TEST(Media, ThinWhiteFogInEvenLightIsInvisible) {
  for (const bool sky : {true, false}) {
    Scene scene = test::furnace(0.0f);
    scene.cameras = {test::lookAt(dvec3(0.1, 0.2, 0.9), dvec3(0.0, 0.0, -1.0), 0.7f)};
    if (sky) {
      scene.materials = {test::lambert(0.0f)};
      scene.meshes.clear(), scene.instances.clear();
      test::place(scene, test::box(vec3(5.0f), vec3(5.01f), 0, false));
      scene.environment.color = vec3(1.0f);
    }
    scene.media.push_back(placed(cube(1.0f)));
    scene.media[0].albedo = vec3(1.0f);
    scene.media[0].density = 0.02f;
    const RayScene rays(scene);
    const LightSet lights(scene, rays);
    const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), 16, 16);
    const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
    Moments all;
    for (std::uint32_t i = 0; i < 256 * 64; ++i) {
      all.add(tracer.sample({i % 16, i / 16 % 16, i / 256}, 16).common);
    }
    EXPECT_NEAR(all.mean().x, 1.0, 0.0025 + 4.0 * std::sqrt(all.varianceOfMean().x)) << sky;
    EXPECT_LT(std::sqrt(all.varianceOfMean().x), 0.003) << sky;
  }
}

TEST(Media, BadValuesAreDroppedAndTinyGridsWork) {
  std::vector<float> values(512, 0.0f);
  values[0] = kNaN, values[1] = -1.0f, values[2] = 1e30f, values[3] = 1.0f;
  asvo::MediumLeaf leaf;
  leaf.values = values;
  const asvo::Medium m = asvo::Medium::build({&leaf, 1});
  EXPECT_EQ(m.dropped, 2u);
  EXPECT_EQ(m.cut, 1u);
  EXPECT_EQ(m.voxels, 2u);
  EXPECT_TRUE(asvo::Medium::build({}).empty());
  EXPECT_EQ(mediaOf(placed(asvo::Medium::build({}))), nullptr);
}

TEST(Media, FileKeepsAllAndNoticesEveryFlippedByte) {
  const vec3 glow(1.0f, 2.0f, 4.0f);
  const asvo::Medium m = cube(0.7f, &glow);
  const std::vector<std::byte> bytes = m.toBytes();
  EXPECT_EQ(asvo::Medium::fromBytes(bytes).toBytes(), bytes);
  for (std::size_t at = 0; at < bytes.size(); at += at < 200 ? 1 : 97) {
    std::vector<std::byte> broken = bytes;
    broken[at] ^= std::byte{4};
    EXPECT_THROW(asvo::Medium::fromBytes(broken), asvo::FormatError) << at;
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{50}, bytes.size() - 1}) {
    EXPECT_THROW(asvo::Medium::fromBytes(std::span(bytes).first(size)), asvo::FormatError);
  }
}

}  // namespace
}  // namespace trex
