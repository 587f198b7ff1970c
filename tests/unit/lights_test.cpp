#include "src/crays/lights.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/unit/chi_square.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

/// A scene as light sampling sees it; places are given in the scene's own space.
struct Lit {
  Scene scene;
  RayScene rays;
  LightSet lights;
  explicit Lit(Scene s) : scene(std::move(s)), rays(scene), lights(scene, rays) {}
  dvec3 at(const dvec3& place) const { return place - rays.renderOrigin(); }
};

/// A black square of 2 m below the lamps, so that the scene has a size.
Scene floorAlone() {
  Scene scene;
  scene.materials = {test::lambert(0.0f)};
  test::place(scene, test::panel(-1.0f, 1.0f, -1.0f, 0, true));
  return scene;
}

/// A square lamp of 1 m at height 1 that shines down with radiance 3.
Scene lamp(bool doubleSided) {
  Scene scene = floorAlone();
  scene.materials.push_back(test::lambert(0.0f, 3.0f));
  scene.materials[1].doubleSided = doubleSided;
  test::place(scene, test::panel(-0.5f, 0.5f, 1.0f, 1, false));
  return scene;
}

TEST(Lights, AreaLampIrradianceMatchesItsFormFactor) {
  const Lit lit(lamp(false));
  const dvec3 point = lit.at(dvec3(0.0));
  double sum = 0.0;
  constexpr int kCount = 20000;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(0, i, 0);
    LightSample s;
    if (!lit.lights.sample(point, sampler, s)) continue;
    sum += static_cast<double>(s.radiance.x * s.direction.y / s.pdf) / kCount;
    RayHit hit;
    ASSERT_TRUE(lit.rays.intersect(vec3(point), s.direction, 0.0f, kInfinity, hit));
    EXPECT_NEAR(s.pdf, lit.lights.pdfEmitter(point, hit, hit.t, s.direction.y), 1e-3f * s.pdf);
  }
  // Form factor of a square of side 1 at distance 1, centred: four corners of 0.5 x 0.5.
  const double a = 0.5, x = a / std::sqrt(1.0 + a * a);
  const double corner = (2.0 * x * std::atan(x)) / (2.0 * std::numbers::pi);
  EXPECT_NEAR(sum, 3.0 * std::numbers::pi * 4.0 * corner, 0.01);
}

TEST(Lights, SingleSidedLampIsDarkBehind) {
  for (bool both : {false, true}) {
    const Lit lit(lamp(both));
    int found = 0;
    for (std::uint32_t i = 0; i < 100; ++i) {
      Sampler sampler(0, i, 0);
      LightSample s;
      found += lit.lights.sample(lit.at(dvec3(0.0, 2.0, 0.0)), sampler, s);
    }
    EXPECT_EQ(found, both ? 100 : 0);
  }
}

TEST(Lights, PhotonsCarryTheLampsPower) {
  for (bool both : {false, true}) {
    const Lit lit(lamp(both));
    vec3 sum(0.0f);
    int down = 0;
    for (std::uint32_t i = 0; i < 1000; ++i) {
      Sampler sampler(1, i, 0);
      EmittedPhoton p;
      ASSERT_TRUE(lit.lights.emit(sampler, p));
      EXPECT_LE(maxComponent(p.power), lit.lights.largestPhotonPower() * 1.0001f);
      sum += p.power / 1000.0f;
      down += p.direction.y < 0.0f;
    }
    EXPECT_NEAR(sum.x, 3.0f * kPi * (both ? 2.0f : 1.0f), 1e-3f);
    EXPECT_NEAR(down, both ? 500 : 1000, both ? 40 : 0);
  }
}

Light pointLight(const dvec3& position, float intensity) {
  Light light;
  light.intensity = vec3(intensity);
  light.position = position;
  return light;
}

TEST(Lights, PointLightFallsWithTheSquare) {
  Scene scene = floorAlone();
  scene.lights = {pointLight(dvec3(0, 2, 0), 8.0f)};
  const Lit lit(scene);
  Sampler sampler(0, 0, 0);
  LightSample s;
  ASSERT_TRUE(lit.lights.sample(lit.at(dvec3(0.0)), sampler, s));
  EXPECT_TRUE(s.delta);
  EXPECT_NEAR(s.radiance.x / s.pdf, 2.0f, 1e-5f);
  EXPECT_NEAR(s.distance, 2.0f, 1e-6f);
}

/// Beams so narrow that cosines of floats and the least gap of KHR_lights_punctual's formula would
/// take their light: whole within the inner cone, none outside of the outer one, and photons carry
/// the integral between both.
TEST(Lights, NarrowSpotsAreAsBrightAsWideOnes) {
  for (const double outer : {1e-4, 1e-3, 1e-2, 0.04, 0.5}) {
    for (const double share : {0.5, 0.97}) {
      const double inner = outer * share;
      Scene scene = floorAlone();
      Light light = pointLight(dvec3(0, 100, 0), 8.0f);
      light.type = Light::Type::kSpot;
      light.direction = vec3(0.0f, -1.0f, 0.0f);
      light.outerConeAngle = static_cast<float>(outer);
      light.innerConeAngle = static_cast<float>(inner);
      scene.lights = {light};
      const Lit lit(scene);
      for (const double at : {0.0, 0.98 * inner, 1.02 * outer}) {
        const LightPoint place(lit.at(dvec3(100.0 * std::tan(at), 0, 0)), vec3(0, 1, 0));
        Sampler sampler(0, 0, 0);
        LightSample s;
        const bool found = lit.lights.sample(place, sampler, s);
        const double expected = at < inner ? 8e-4 * std::pow(std::cos(at), 2) : 0.0;
        const double got = found ? static_cast<double>(s.radiance.x / s.pdf) : 0.0;
        EXPECT_NEAR(got, expected, 1e-5 * expected) << outer << ' ' << share << ' ' << at;
      }
      const auto versine = [](double a) { return 2.0 * std::pow(std::sin(0.5 * a), 2); };
      const double expected =
          2.0 * std::numbers::pi * 8.0 * (versine(inner) + (versine(outer) - versine(inner)) / 3.0);
      double sum = 0.0;
      constexpr std::uint32_t kCount = 1 << 14;
      for (std::uint32_t i = 0; i < kCount; ++i) {
        Sampler sampler(1, i, 0);
        EmittedPhoton p;
        if (!lit.lights.emit(sampler, p)) continue;
        sum += static_cast<double>(p.power.x) / kCount;
        EXPECT_LE(std::acos(std::min(-static_cast<double>(p.direction.y), 1.0)),
                  1.001 * outer + 4e-4);
      }
      EXPECT_NEAR(sum / expected, 1.0, 0.01) << outer << ' ' << share;
    }
  }
}

/// Estimates of the irradiance on a place that faces up, without shadows: mean, and deviation of
/// one sample over it.
struct Irradiance {
  double mean = 0.0, noise = 0.0;
};
Irradiance irradianceOf(const Lit& lit, const dvec3& place, std::uint32_t samples) {
  double sum = 0.0, squares = 0.0;
  const LightPoint at(lit.at(place), vec3(0.0f, 1.0f, 0.0f));
  for (std::uint32_t i = 0; i < samples; ++i) {
    Sampler sampler(i, 0, 7);  // pixels, so that samples are independent
    LightSample s;
    if (!lit.lights.sample(at, sampler, s)) continue;
    const double e =
        static_cast<double>(luminance(s.radiance) * std::max(s.direction.y, 0.0f) / s.pdf);
    sum += e;
    squares += e * e;
  }
  const double mean = sum / samples;
  return {mean, std::sqrt(std::max(squares / samples - mean * mean, 0.0)) / mean};
}

/// Point lights and lamps in turn on a ceiling of 8 m by 6 m.
Scene ceiling(int count) {
  Scene scene = floorAlone();
  scene.materials.push_back(test::lambert(0.0f, 30.0f));
  for (int i = 0; i < count; ++i) {
    const float x = static_cast<float>(i % 8) - 3.5f, z = static_cast<float>(i / 8) - 3.0f;
    if (i % 2 == 0) {
      scene.lights.push_back(pointLight(dvec3(x, 2.5, z), 5.0f));
    } else {
      Mesh mesh = test::panel(-0.1f, 0.1f, 2.5f, 1, false);
      for (vec3& p : mesh.positions) p += vec3(x, 0.0f, z);
      test::place(scene, std::move(mesh));
    }
  }
  return scene;
}

TEST(Lights, NoiseDoesNotJumpWithTheirNumber) {
  const Lit few(ceiling(48)), more(ceiling(49));
  for (const dvec3& place : {dvec3(0.0), dvec3(2.3, 0.5, -1.7), dvec3(-3.0, 1.9, 2.0)}) {
    const Irradiance a = irradianceOf(few, place, 20000), b = irradianceOf(more, place, 20000);
    EXPECT_LT(b.noise, 1.1 * a.noise);
    EXPECT_LT(a.noise, 1.0);
  }
}

/// Lamps along a street, 12 m apart on both sides; every other one is a point light.
Scene street(int lamps) {
  Scene scene = floorAlone();
  scene.materials.push_back(test::lambert(0.0f, 100.0f));
  for (int i = 0; i < lamps; ++i) {
    const double x = 12.0 * (i / 2 - lamps / 4) + 3.0, z = i % 2 == 0 ? -4.0 : 4.0;
    if (i / 2 % 2 == 0) {
      scene.lights.push_back(pointLight(dvec3(x, 5.0, z), 9.0f));
    } else {
      Mesh mesh = test::panel(-0.15f, 0.15f, 5.0f, 1, false);
      mesh.origin = dvec3(x, 0.0, z);
      test::place(scene, std::move(mesh));
    }
  }
  return scene;
}

TEST(Lights, AStreetIsAsSmoothAsItsNearestLamps) {
  const Lit near(street(64)), all(street(4096));
  for (const dvec3& place : {dvec3(0.0), dvec3(4.0, 0.0, 3.9), dvec3(9.0, 3.0, -1.0)}) {
    const Irradiance a = irradianceOf(near, place, 20000), b = irradianceOf(all, place, 20000);
    EXPECT_LT(b.noise, 1.5 * a.noise);
    EXPECT_NEAR(b.mean / a.mean, 1.0, 0.05);
  }
}

/// A sun and a lamp are each found as often as they matter.
TEST(Lights, ASunDoesNotHideLamps) {
  Scene scene = ceiling(30);
  Light sun;
  sun.type = Light::Type::kDirectional;
  sun.direction = vec3(0.0f, -1.0f, 0.0f);
  sun.intensity = vec3(10.0f);
  const Irradiance lamps = irradianceOf(Lit(scene), dvec3(0.0), 20000);
  scene.lights.push_back(sun);
  const Irradiance both = irradianceOf(Lit(scene), dvec3(0.0), 20000);
  EXPECT_NEAR(both.mean, lamps.mean + 10.0, 0.01 * both.mean);
  EXPECT_LT(both.noise, 1.1 * std::max(lamps.noise, 0.5));
}

/// Triangles without area, of no power, hidden ones, and unlit ones are no lights.
TEST(Lights, WhatDoesNotShineIsNotInTheSet) {
  Scene scene = lamp(false);
  scene.meshes[1].positions[2] = scene.meshes[1].positions[1];
  scene.meshes[1].positions[3] = scene.meshes[1].positions[1];
  EXPECT_TRUE(Lit(scene).lights.empty());
  scene = lamp(false);
  scene.materials[1].unlit = true;
  EXPECT_TRUE(Lit(scene).lights.empty());
  scene = lamp(false);
  RayScene rays(scene);
  Visibility hidden;
  hidden.hidden = {0, 1};
  rays.setVisibility(hidden);
  EXPECT_TRUE(LightSet(scene, rays).empty());
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
  Scene scene = floorAlone();
  scene.environment.map = skyWithSun();
  scene.environment.color = vec3(1.0f);
  const Lit lit(scene);
  const LightSet& lights = lit.lights;
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

/// One texel far above the others: look-ups mix it into its neighbours, corners too, and all of
/// that is found by light sampling, not by rare chance.
TEST(Lights, ASparkOfAMapIsFoundWithItsNeighbours) {
  Scene scene = floorAlone();
  const auto map = std::make_shared<Image>();
  map->width = 64;
  map->height = 32;
  map->channels = 3;
  map->floats.assign(64 * 32 * 3, 1e-4f);
  for (std::size_t c = 0; c < 3; ++c) map->floats[(9 * 64 + 20) * 3 + c] = 1000.0f;
  scene.environment.map = map;
  scene.environment.color = vec3(1.0f);
  const Lit lit(scene);
  double expected = 0.0;
  constexpr int kFine = 8, kRows = 32 * kFine, kColumns = 64 * kFine;
  for (int i = 0; i < kRows / 2; ++i) {
    for (int j = 0; j < kColumns; ++j) {
      const double theta = std::numbers::pi * (i + 0.5) / kRows;
      const double phi = 2.0 * std::numbers::pi * ((j + 0.5) / kColumns - 0.5);
      const vec3 d(dvec3(std::sin(theta) * std::sin(phi), std::cos(theta),
                         -std::sin(theta) * std::cos(phi)));
      expected += static_cast<double>(lit.lights.environment(d).x) * std::cos(theta) *
                  std::sin(theta) * 2.0 * std::numbers::pi * std::numbers::pi / (kRows * kColumns);
    }
  }
  const Irradiance found = irradianceOf(lit, dvec3(0.0), 1 << 14);
  EXPECT_NEAR(found.mean / expected, 1.0, 0.02);
  EXPECT_LT(found.noise, 1.3);
}

/// Every emitted photon's power agrees with the irradiance it stands for: sum over a plane.
TEST(Lights, SkyPhotonsCarryTheSkysPower) {
  Scene scene = floorAlone();
  scene.environment.color = vec3(2.0f);
  const Lit lit(scene);
  const LightSet& lights = lit.lights;
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
