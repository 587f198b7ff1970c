#include "src/crays/lights.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/unit/chi_square.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

Box3f unitBounds() {
  Box3f b;
  b.extend(vec3(-1.0f));
  b.extend(vec3(1.0f));
  return b;
}

/// A square lamp of 1 m at height 1 that shines down with radiance 3.
Scene lamp(bool doubleSided) {
  Scene scene;
  Material m = test::lambert(0.0f, 3.0f);
  m.doubleSided = doubleSided;
  scene.materials = {m};
  Mesh mesh;
  mesh.positions = {vec3(-0.5f, 1, -0.5f), vec3(0.5f, 1, -0.5f), vec3(0.5f, 1, 0.5f),
                    vec3(-0.5f, 1, 0.5f)};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  test::place(scene, mesh);
  return scene;
}

TEST(Lights, AreaLampIrradianceMatchesItsFormFactor) {
  const Scene scene = lamp(false);
  const LightSet lights(scene, dvec3(0.0), unitBounds());
  double sum = 0.0;
  constexpr int kCount = 20000;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(0, i, 0);
    LightSample s;
    if (!lights.sample(vec3(0.0f), sampler, s)) continue;
    sum += static_cast<double>(s.radiance.x * s.direction.y / s.pdf) / kCount;
    EXPECT_NEAR(s.pdf, lights.pdfEmitter(vec3(0.0f), 0, 0, s.distance, s.direction.y),
                1e-3f * s.pdf);
  }
  // Form factor of a square of side 1 at distance 1, centred: four corners of 0.5 x 0.5.
  const double a = 0.5, x = a / std::sqrt(1.0 + a * a);
  const double corner = (2.0 * x * std::atan(x)) / (2.0 * std::numbers::pi);
  EXPECT_NEAR(sum, 3.0 * std::numbers::pi * 4.0 * corner, 0.01);
}

TEST(Lights, SingleSidedLampIsDarkBehind) {
  for (bool both : {false, true}) {
    const Scene scene = lamp(both);
    const LightSet lights(scene, dvec3(0.0), unitBounds());
    int found = 0;
    for (std::uint32_t i = 0; i < 100; ++i) {
      Sampler sampler(0, i, 0);
      LightSample s;
      found += lights.sample(vec3(0.0f, 2.0f, 0.0f), sampler, s);
    }
    EXPECT_EQ(found, both ? 100 : 0);
  }
}

TEST(Lights, PhotonsCarryTheLampsPower) {
  for (bool both : {false, true}) {
    const Scene scene = lamp(both);
    const LightSet lights(scene, dvec3(0.0), unitBounds());
    vec3 sum(0.0f);
    int down = 0;
    for (std::uint32_t i = 0; i < 1000; ++i) {
      Sampler sampler(1, i, 0);
      EmittedPhoton p;
      ASSERT_TRUE(lights.emit(sampler, p));
      EXPECT_LE(maxComponent(p.power), lights.largestPhotonPower() * 1.0001f);
      sum += p.power / 1000.0f;
      down += p.direction.y < 0.0f;
    }
    EXPECT_NEAR(sum.x, 3.0f * kPi * (both ? 2.0f : 1.0f), 1e-3f);
    EXPECT_NEAR(down, both ? 500 : 1000, both ? 40 : 0);
  }
}

TEST(Lights, PointLightFallsWithTheSquare) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  Light light;
  light.intensity = vec3(8.0f);
  light.position = dvec3(0, 2, 0);
  scene.lights = {light};
  const LightSet lights(scene, dvec3(0.0), unitBounds());
  Sampler sampler(0, 0, 0);
  LightSample s;
  ASSERT_TRUE(lights.sample(vec3(0.0f), sampler, s));
  EXPECT_TRUE(s.delta);
  EXPECT_NEAR(s.radiance.x / s.pdf, 2.0f, 1e-5f);
  EXPECT_NEAR(s.distance, 2.0f, 1e-6f);
}

std::shared_ptr<Image> skyWithSun() {
  auto map = std::make_shared<Image>();
  map->width = 32;
  map->height = 16;
  map->channels = 3;
  map->floats.assign(32 * 16 * 3, 0.5f);
  for (int c = 0; c < 3; ++c) map->floats[static_cast<std::size_t>((4 * 32 + 20) * 3 + c)] = 200.0f;
  return map;
}

/// Sampled directions of the map against pdfEnvironment over cells of the sphere.
TEST(Lights, EnvironmentSamplesFollowTheirDensity) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  scene.environment.map = skyWithSun();
  scene.environment.color = vec3(1.0f);
  const LightSet lights(scene, dvec3(0.0), unitBounds());
  constexpr int kCount = 200000, kZ = 16, kPhi = 32, kFine = 16;
  std::vector<double> counts(kZ * kPhi, 0.0), expected(kZ * kPhi, 0.0);
  const auto cell = [&](const vec3& d) {
    const double z = std::clamp(0.5 + 0.5 * static_cast<double>(d.y), 0.0, 0.999999);
    const double phi = std::atan2(d.x, d.z) / (2.0 * std::numbers::pi) + 0.5;
    return static_cast<std::size_t>(z * kZ) * kPhi +
           static_cast<std::size_t>(std::min(phi, 0.999999) * kPhi);
  };
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(i, 0, 5);
    LightSample s;
    if (!lights.sample(vec3(0.0f), sampler, s)) continue;
    counts[cell(s.direction)] += 1.0;
    EXPECT_NEAR(lights.pdfEnvironment(vec3(0.0f), s.direction) / s.pdf, 1.0f, 1e-4f);
  }
  for (int i = 0; i < kZ * kFine; ++i) {
    for (int j = 0; j < kPhi * kFine; ++j) {
      const double y = 2.0 * (i + 0.5) / (kZ * kFine) - 1.0, r = std::sqrt(1.0 - y * y);
      const double phi = 2.0 * std::numbers::pi * ((j + 0.5) / (kPhi * kFine) - 0.5);
      const vec3 d(static_cast<float>(r * std::sin(phi)), static_cast<float>(y),
                   static_cast<float>(r * std::cos(phi)));
      expected[cell(d)] += static_cast<double>(lights.pdfEnvironment(vec3(0.0f), d)) * kCount *
                           4.0 * std::numbers::pi / (kZ * kFine * kPhi * kFine);
    }
  }
  EXPECT_GT(test::chiSquareP(counts, expected), 1e-3);
}

/// Every emitted photon's power agrees with the irradiance it stands for: sum over a plane.
TEST(Lights, SkyPhotonsCarryTheSkysPower) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  scene.environment.color = vec3(2.0f);
  const LightSet lights(scene, dvec3(0.0), unitBounds());
  // Irradiance on a unit square facing up at the centre must be pi * 2.
  double through = 0.0;
  constexpr int kCount = 400000;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(1, i, 0);
    EmittedPhoton p;
    ASSERT_TRUE(lights.emit(sampler, p));
    if (p.direction.y >= 0.0f) continue;
    const vec3 origin(p.start.position), at = origin - p.direction * (origin.y / p.direction.y);
    if (std::abs(at.x) < 0.5f && std::abs(at.z) < 0.5f) through += static_cast<double>(p.power.x);
  }
  EXPECT_NEAR(through / kCount / (2.0 * std::numbers::pi), 1.0, 0.02);
  EXPECT_TRUE(lights.empty());  // nothing for light sampling
}

}  // namespace
}  // namespace trex
