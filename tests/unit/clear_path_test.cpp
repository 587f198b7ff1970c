#include "src/crays/clear_path.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {

constexpr float kAlbedo = 1e-3f;

/// Mean exact radiance of a picture of 8x8 pixels.
vec3 render(const Scene& scene, std::uint32_t samples) {
  constexpr std::uint32_t kSide = 8;
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
  Moments all;
  for (std::uint32_t s = 0; s < samples; ++s) {
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      all.add(tracer.sample({i % kSide, i / kSide, s}, kSide).common);
    }
  }
  return vec3(all.mean());
}

/// A dark floor, so that little returns to it from the glass, seen at (x, 0, 0) from close by,
/// below whatever is placed above y = 0.5.
Scene floorAt(float x) {
  Scene scene;
  scene.materials = {test::lambert(kAlbedo)};
  test::place(scene, test::sheet(12.0f, 0.0f, 0));
  scene.cameras = {test::lookAt(dvec3(x, 0.2, 0.01), dvec3(x, 0.0, 0.0), 0.002f)};
  return scene;
}

/// Irradiance of the floor seen by the camera.
vec3 irradiance(const Scene& scene, std::uint32_t samples = 1) {
  return render(scene, samples) * (kPi / kAlbedo);
}

struct Layer {
  double thickness, index;
};

/// Irradiance at distance x of a floor from a light of intensity 1 at `height` over it, through
/// parallel layers in the air between: what leaves between two angles lands on a ring.
double throughLayers(const std::vector<Layer>& layers, double height, double x) {
  double air = height;
  for (const Layer& l : layers) air -= l.thickness;
  const auto reach = [&](double angle) {
    double r = air * std::tan(angle);
    for (const Layer& l : layers) r += l.thickness * std::tan(std::asin(std::sin(angle) / l.index));
    return r;
  };
  double low = 0.0, high = 1.57;
  for (int i = 0; i < 100; ++i) (reach(0.5 * (low + high)) < x ? low : high) = 0.5 * (low + high);
  const double step = 1e-5;
  double passed = 1.0;
  for (const Layer& l : layers) {
    const auto cosine = static_cast<float>(std::cos(low));
    const double once = 1.0 - fresnelDielectric(cosine, static_cast<float>(l.index));
    passed *= once * once;
  }
  const double slope = (reach(low + step) - reach(low - step)) / (2.0 * step);
  return passed * std::sin(low) / (x * slope);
}

TEST(ClearPath, SpreadOfAnUnbentPathIsItsLengthSquared) {
  ClearPath path;
  path.begin(vec3(0.0f, -1.0f, 0.0f), 1.0f);
  path.advance(2.0f);
  EXPECT_NEAR(path.spread(), 9.0f, 1e-5f);
  EXPECT_TRUE(path.straight(vec3(0.0f, -1.0f, 0.0f)));
  EXPECT_FALSE(path.straight(glm::normalize(vec3(0.002f, -1.0f, 0.0f))));
}

TEST(ClearPath, EndsWhereItsMediumWas) {
  ClearPath path;
  path.begin(vec3(0.0f, -1.0f, 0.0f), 1.0f);
  path.refract(vec3(0.0f, 1.0f, 0.0f), 1.5f, vec3(0.0f, -1.0f, 0.0f));
  EXPECT_FALSE(path.straight(vec3(0.0f, -1.0f, 0.0f)));
  path.refract(vec3(0.0f, 1.0f, 0.0f), 1.0f / 1.5f, vec3(0.0f, -1.0f, 0.0f));
  EXPECT_TRUE(path.straight(vec3(0.0f, -1.0f, 0.0f)));
}

TEST(ClearGlass, PointLightThroughAThinTintedSheet) {
  for (const float x : {0.0f, 1.0f, 6.0f}) {
    Scene scene = floorAt(x);
    scene.materials.push_back(test::glass(false));
    scene.materials[1].baseColor = vec4(1.0f, 0.5f, 0.25f, 1.0f);
    test::place(scene, test::sheet(8.0f, 1.0f, 1));
    scene.lights = {test::pointLight(dvec3(0.0, 2.0, 0.0), 10.0f)};
    const float d2 = x * x + 4.0f, cosine = 2.0f / std::sqrt(d2);
    const float once = fresnelDielectric(cosine, 1.5f);
    const vec3 right =
        vec3(1.0f, 0.5f, 0.25f) * (10.0f * cosine / d2 * (1.0f - 2.0f * once / (1.0f + once)));
    const vec3 got = irradiance(scene);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(got[c] / right[c], 1.0f, 2e-3f) << x;
  }
}

TEST(ClearGlass, PointLightThroughPanes) {
  for (const float x : {0.02f, 1.0f, 3.0f, 10.0f}) {
    for (const bool two : {false, true}) {
      Scene scene = floorAt(x);
      scene.materials.push_back(test::glass(true));
      scene.materials.push_back(test::glass(true));
      scene.materials[2].ior = 1.8f;
      test::place(scene, test::pane(8.0f, 0.8f, 0.3f, 1));
      std::vector<Layer> layers = {{0.3, 1.5}};
      if (two) {
        test::place(scene, test::pane(8.0f, 1.3f, 0.2f, 2));
        layers.push_back({0.2, 1.8});
      }
      scene.lights = {test::pointLight(dvec3(0.0, 2.0, 0.0), 10.0f)};
      EXPECT_NEAR(irradiance(scene).x / (10.0 * throughLayers(layers, 2.0, x)), 1.0, 5e-3)
          << x << ' ' << two;
    }
  }
}

TEST(ClearGlass, SunThroughAnAbsorbingPane) {
  for (const float angle : {0.0f, 0.7f, 1.3f}) {
    Scene scene = floorAt(0.0f);
    scene.materials.push_back(test::glass(true));
    scene.materials[1].attenuationColor = vec3(0.8f, 0.4f, 0.1f);
    scene.materials[1].attenuationDistance = 0.1f;
    test::place(scene, test::pane(8.0f, 1.0f, 0.05f, 1));
    scene.lights = {test::sun(vec3(std::sin(angle), -std::cos(angle), 0.0f), 3.0f)};
    const float inside = std::asin(std::sin(angle) / 1.5f);
    const float once = 1.0f - fresnelDielectric(std::cos(angle), 1.5f);
    const vec3 got = irradiance(scene);
    for (int c = 0; c < 3; ++c) {
      const float passed =
          std::pow(scene.materials[1].attenuationColor[c], 0.5f / std::cos(inside));
      EXPECT_NEAR(got[c] / (3.0f * std::cos(angle) * once * once * passed), 1.0f, 3e-3f) << angle;
    }
  }
}

/// Two sheets that cross, one of them half transparent by its alpha, and one that half scatters.
TEST(ClearGlass, LayersOfAllKindsMultiply) {
  Scene scene = floorAt(0.0f);
  scene.materials.resize(4, test::glass(false));
  scene.materials[1].alphaMode = AlphaMode::kBlend;
  scene.materials[1].baseColor.w = 0.4f;
  scene.materials[2].transmission = 0.5f;
  scene.materials[3] = test::glass(true);
  test::place(scene, test::sheet(3.0f, 1.0f, 1));
  test::place(scene, test::sheet(3.0f, 1.5f, 2));
  test::place(scene, test::pane(3.0f, 1.6f, 0.1f, 3));
  scene.lights = {test::pointLight(dvec3(0.0, 8.0, 0.0), 100.0f)};
  const RayScene rays(scene);
  const ClearLayers layers(scene, rays);
  const vec3 from = vec3(dvec3(0.1, 0.5, 0.2) - rays.renderOrigin());
  const float once = 0.04f, thin = 1.0f - 2.0f * once / (1.0f + once);
  const LightConnection way = layers.connect(from, vec3(0.0f, 1.0f, 0.0f), 7.5f, vec3(0.0f));
  EXPECT_NEAR(way.passed.x, (0.6f + 0.4f * thin) * 0.5f * thin * 0.96f * 0.96f, 1e-4f);
  const float spread = 7.4f + 0.1f / 1.5f;
  EXPECT_NEAR(way.focus, 7.5f * 7.5f / (spread * spread), 1e-4f);
}

TEST(ClearGlass, LensesRoughGlassAndSingleFacesAreNoPanes) {
  Scene scene = floorAt(0.0f);
  scene.materials.resize(3, test::glass(true));
  scene.materials[2] = test::glass(false);
  scene.materials[2].roughness = 0.5f;
  const auto passed = [&](Mesh mesh) {
    Scene with = scene;
    test::place(with, std::move(mesh));
    const RayScene rays(with);
    const vec3 from = vec3(dvec3(0.3, 0.1, 0.1) - rays.renderOrigin());
    return ClearLayers(with, rays).connect(from, vec3(0.0f, 1.0f, 0.0f), 5.0f, vec3(0.0f)).passed;
  };
  EXPECT_EQ(passed(test::sphere(vec3(0.0f, 2.0f, 0.0f), 1.0f, 1, 32)), vec3(0.0f));
  EXPECT_EQ(passed(test::sheet(3.0f, 1.0f, 1)), vec3(0.0f));
  EXPECT_EQ(passed(test::sheet(3.0f, 1.0f, 2)), vec3(0.0f));
}

/// What blocks a straight line is not asked of each ray by walking; the answers are the walk's, in
/// merged and in placed meshes. Ways that glass bends are ways through it: past its edge, where a
/// straight line meets it, no light is found.
TEST(ClearGlass, ConnectionsAreThoseOfTheWalk) {
  for (const int copies : {1, 2}) {
    Scene scene = floorAt(0.0f);
    scene.materials.push_back(test::glass(false));
    scene.materials.push_back(test::glass(true));
    scene.materials.push_back(test::lambert(0.5f));
    test::place(scene, test::sheet(0.7f, 1.0f, 1));
    test::place(scene, test::pane(0.5f, 1.5f, 0.2f, 2));
    test::place(scene, test::sheet(0.6f, 2.0f, 3));
    test::place(scene, test::sphere(vec3(1.2f, 1.0f, 0.0f), 0.4f, 2, 64));
    for (int i = 1; i < copies; ++i) {
      Instance copy = scene.instances.back();
      copy.transform[3] = glm::dvec4(-2.4 * i, 0.0, 0.0, 1.0);
      scene.instances.push_back(copy);
    }
    const RayScene rays(scene);
    ASSERT_EQ(rays.statistics().instances, copies == 1 ? 0u : 2u);
    const ClearLayers layers(scene, rays);
    Sampler sampler(0, 0, 5);
    int blocked = 0, bent = 0, through = 0, clear = 0;
    for (int i = 0; i < 20000; ++i) {
      const auto place = [&](double low, double high) {
        const vec2 u = sampler.next2D();
        const double y = low + (high - low) * static_cast<double>(sampler.next1D());
        return dvec3(4.0 * static_cast<double>(u.x) - 2.0, y,
                     2.0 * static_cast<double>(u.y) - 1.0) -
               rays.renderOrigin();
      };
      const dvec3 from = place(0.1, 0.9), to = place(2.1, 3.0);
      const vec3 direction(glm::normalize(to - from));
      const RayEnd end(static_cast<float>(glm::length(to - from)), to);
      const ClearWalk walk = layers.walk(from, direction, end);
      const LightConnection way = layers.connect(from, direction, end);
      if (walk.path.begun()) {
        ++bent;
        if (!way.reaches()) continue;
        ++through;
        EXPECT_TRUE(way.refracted);
        const ClearWalk taken = layers.walk(from, way.direction, end);
        EXPECT_TRUE(taken.path.begun() && !taken.blocked);
        EXPECT_EQ(way.passed, taken.passed);
        continue;
      }
      EXPECT_EQ(way.reaches(), !walk.blocked);
      EXPECT_FALSE(way.refracted);
      EXPECT_EQ(way.passed, walk.blocked ? vec3(0.0f) : walk.passed);
      (walk.blocked ? blocked : clear) += 1;
    }
    EXPECT_GT(std::min({blocked, bent, clear}), 1000);
    EXPECT_GT(through, 300);
  }
}

/// A card over a pane hides a light from where the straight line meets the card, but the pane moves
/// the way past its edge: there is light, and on the other side of the edge none.
TEST(ClearGlass, ThePaneMovesTheShadowOfACard) {
  constexpr double kThick = 0.5, kHeight = 4.0;
  // Rays of a sun at 45 degrees are moved by the pane towards where they come from.
  const double inside = std::asin(std::sin(0.25 * kPi) / 1.5);
  const double moved = kThick * (1.0 - std::tan(inside));
  for (const double beyond : {-0.05, 0.05}) {
    Scene scene = floorAt(0.0f);
    scene.materials.push_back(test::glass(true));
    scene.materials.push_back(test::lambert(0.0f));
    test::place(scene, test::pane(8.0f, 1.0f, static_cast<float>(kThick), 1));
    Mesh card = test::sheet(1.0f, static_cast<float>(kHeight), 2);
    // Its edge at -x ends the shadow at the floor's x = 0, pane included, plus `beyond`.
    for (vec3& p : card.positions) p.x += static_cast<float>(kHeight - moved + 1.0 + beyond);
    test::place(scene, card);
    scene.lights = {test::sun(glm::normalize(vec3(-1.0f, -1.0f, 0.0f)), 3.0f)};
    const float light = irradiance(scene).x;
    if (beyond > 0.0) {
      EXPECT_NEAR(light / (3.0f * std::sqrt(0.5f) *
                           std::pow(1.0f - fresnelDielectric(std::sqrt(0.5f), 1.5f), 2.0f)),
                  1.0f, 0.02f);
    } else {
      EXPECT_LT(light, 0.01f);
    }
  }
}

/// In a furnace glass can't be seen. Lamps are found by light sampling and by paths on every way
/// through it, so the weights of both must add up to one.
TEST(ClearGlass, FurnaceWithGlassIsExact) {
  for (const int kind : {0, 1, 2}) {
    Scene scene = test::furnace(0.5f);
    scene.materials.push_back(test::glass(kind > 0));
    if (kind == 0) test::place(scene, test::sheet(0.6f, -0.3f, 1, 0.4f));
    if (kind == 1) test::place(scene, test::pane(0.7f, -0.3f, 0.3f, 1));
    if (kind == 2) test::place(scene, test::sphere(vec3(0.3f, 0.1f, 0.0f), 0.5f, 1, 16));
    scene.cameras = {test::lookAt(dvec3(0.2, -0.9, 0.3), dvec3(0.1, -1.0, 0.2), 1.2f)};
    EXPECT_NEAR(render(scene, 512).x, 2.0f, 0.012f) << kind;
  }
}

/// So it is with a white ball in a hollow box of glass under a sky of a map, which is sampled.
TEST(ClearGlass, WhiteBallInAGlassBoxIsInvisible) {
  Scene scene;
  scene.materials = {test::lambert(1.0f), test::glass(true)};
  test::place(scene, test::sphere(vec3(0.0f), 0.5f, 0, 16));
  test::place(scene, test::box(vec3(-1.0f), vec3(1.0f), 1, false));
  test::place(scene, test::box(vec3(-0.9f), vec3(0.9f), 1, true));
  auto map = std::make_shared<Image>();
  map->width = 4;
  map->height = 2;
  map->channels = 3;
  map->floats.assign(24, 1.0f);
  scene.environment.color = vec3(0.7f);
  scene.environment.map = map;
  scene.cameras = {test::lookAt(dvec3(0, 0, 0.8), dvec3(0.0), 0.3f)};
  EXPECT_NEAR(render(scene, 512).x, 0.7f, 0.007f);
}

}  // namespace
}  // namespace trex
