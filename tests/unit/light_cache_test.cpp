#include "src/crays/light_cache.h"

#include <gtest/gtest.h>

#include <random>

#include "src/crays/lights_detail.h"
#include "src/session/model.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {

/// A floor of 4 m with a carpet on its far half.
TEST(LightCache, LayersThatHideEachOtherHaveNoLightOfTheirOwn) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::sheet(2.0f, 0.0f, 0));
  Mesh carpet = test::sheet(1.0f, 0.002f, 0);
  for (vec3& p : carpet.positions) p.x += 1.0f;
  test::place(scene, carpet);
  test::place(scene, test::sheet(2.0f, 1.0f, 0));  // far from both
  ModelOptions options;
  options.voxelDepth = 6;
  options.voxelsInTheDark = true;
  const Model model = makeModel(scene, options);
  ASSERT_NE(model.voxels, nullptr);
  LightCache cache(*model.voxels);
  const std::uint32_t white = cache.tracer().asvoPackRgb9e5(vec3(1.0f));
  const std::vector<asvo::uvec4> light(model.voxels->nodes.size(), asvo::uvec4(white));
  cache.setLight(light, 1.0, 0.0);
  const dvec3 origin = model.rays->renderOrigin();
  const auto reads = [&](const dvec3& at, float normal, float radius) {
    vec3 irradiance;
    return cache.irradiance(vec3(at - origin), vec3(0.0f, normal, 0.0f), radius, vec2(0.5f),
                            irradiance);
  };
  for (const float radius : {0.05f, 0.2f}) {
    EXPECT_TRUE(reads(dvec3(-1.1, 0.0, 0.3), 1.0f, radius));
    EXPECT_FALSE(reads(dvec3(1.1, 0.002, 0.3), 1.0f, radius));
    EXPECT_TRUE(reads(dvec3(1.1, 1.0, 0.3), -1.0f, radius));
  }
}

/// A place is looked for from a table on; what is found is what the tree has there.
TEST(LightCache, FindsWhatTheTreeHas) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::sphere(vec3(0.3f, 0.1f, -0.2f), 1.7f, 0, 24));
  for (const int depth : {4, 5, 8}) {
    ModelOptions options;
    options.voxelDepth = depth;
    options.voxelsInTheDark = true;
    const Model model = makeModel(scene, options);
    const asvo::Tree& tree = *model.voxels;
    LightCache cache(tree);
    std::vector<asvo::uvec4> light;  // of each node another
    for (std::uint32_t i = 0; i < tree.nodes.size(); ++i) {
      const vec3 number(static_cast<float>(i % 100), static_cast<float>(i / 100 % 100),
                        static_cast<float>(i / 10000));
      light.emplace_back(cache.tracer().asvoPackRgb9e5(number));
    }
    cache.setLight(light, 1.0, 1e9);
    const dvec3 origin = model.rays->renderOrigin();
    int found = 0;
    for (std::uint32_t i = 0; i < 2000; ++i) {
      const vec3 normal = uniformSphere(Sampler(3, i, 0).next2D());
      const vec3 at(dvec3(vec3(0.3f, 0.1f, -0.2f) + 1.7f * normal) - origin);
      vec3 irradiance;
      const std::uint32_t voxel = cache.tracer().asvoFind(at, tree.info.depth);
      if (voxel == asvo::ASVO_NONE) continue;  // beside the facets
      if (!cache.irradiance(at, normal, 0.0f, vec2(0.5f), irradiance)) continue;
      EXPECT_EQ(irradiance, cache.tracer().asvoUnpackRgb9e5(light[voxel].x));
      ++found;
    }
    EXPECT_GT(found, 1000) << depth;
  }
}

/// The more photons there are, the finer are the voxels that a footprint reads.
TEST(LightCache, FootprintsReadFinerVoxelsOfMorePhotons) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::sheet(2.0f, 0.0f, 0));
  ModelOptions options;
  options.voxelDepth = 6;
  options.voxelsInTheDark = true;
  const Model model = makeModel(scene, options);
  const asvo::Tree& tree = *model.voxels;
  LightCache cache(tree);
  // Each node's light is its level.
  std::vector<asvo::uvec4> light(tree.nodes.size());
  for (std::uint32_t level = 0; level <= tree.info.depth; ++level) {
    for (std::uint32_t i = tree.levelOffsets[level]; i < tree.levelOffsets[level + 1]; ++i) {
      light[i] = asvo::uvec4(cache.tracer().asvoPackRgb9e5(vec3(static_cast<float>(level))));
    }
  }
  const auto levelRead = [&](double photonsOfLeaf, float radius) {
    cache.setLight(light, 1.0, photonsOfLeaf * tree.info.leafCount);
    vec3 value(-1.0f);
    EXPECT_TRUE(cache.irradiance(vec3(dvec3(0.3, 0.0, 0.2) - model.rays->renderOrigin()),
                                 vec3(0.0f, 1.0f, 0.0f), radius * cache.leafSize(), vec2(0.5f),
                                 value));
    return static_cast<std::uint32_t>(value.x + 0.5f);
  };
  const std::uint32_t leaves = tree.info.depth;
  EXPECT_EQ(levelRead(0.5, 5.0f), leaves - 2);
  EXPECT_EQ(levelRead(2.0, 5.0f), leaves - 1);
  EXPECT_EQ(levelRead(10.0, 5.0f), leaves);
  EXPECT_EQ(levelRead(0.5, 2.5f), leaves - 1);
  // Leaves of few photons are not read at all, and rays that would have to go on.
  const auto reads = [&](double photonsOfLeaf, std::uint32_t level) {
    EXPECT_EQ(levelRead(photonsOfLeaf, 1.0f), level);
    EXPECT_EQ(cache.detail(), std::ldexp(cache.leafSize(), static_cast<int>(leaves - level)));
  };
  reads(1.0, leaves);
  reads(0.5, leaves - 1);
  reads(0.25, leaves - 1);
  reads(0.2, leaves - 2);
  reads(0.001, leaves - 2);
  reads(1.0, leaves);  // more of them bring the detail back
}

/// What is told of the noise has the variance of the light, over many lots of photons, and no mean.
TEST(LightCache, TellsAPictureOfItsNoise) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::sheet(2.0f, 0.0f, 0));
  ModelOptions options;
  options.voxelDepth = 4;
  options.voxelsInTheDark = true;
  const Model model = makeModel(scene, options);
  LightCache cache(*model.voxels);
  const vec3 at(dvec3(0.3, 0.0, 0.2) - model.rays->renderOrigin());
  std::mt19937 random(1);
  constexpr int kLots = 4000;
  const double scale = 3.0;
  for (const double before : {30.0, 100.0, 170.0}) {
    const double all = 200.0;
    double mean = 0.0, variance = 0.0, noiseMean = 0.0, noiseSquare = 0.0;
    for (int i = 0; i < kLots; ++i) {
      // As many watts as photons come, each of which may as well not.
      std::poisson_distribution<int> first(before), later(all - before);
      const double early = first(random), whole = early + later(random);
      const auto lightOf = [&](double value) {
        const auto packed = cache.tracer().asvoPackRgb9e5(vec3(static_cast<float>(value)));
        return std::vector<asvo::uvec4>(model.voxels->nodes.size(), asvo::uvec4(packed));
      };
      const auto light = lightOf(whole / all), lightBefore = lightOf(early / before);
      cache.setLight(light, scale, all, lightBefore, before);
      vec3 value(0.0f), noise(0.0f), same(0.0f);
      const vec3 up(0.0f, 1.0f, 0.0f);
      ASSERT_TRUE(cache.noisyIrradiance(at, up, 0.1f, vec2(0.5f), 0, value, noise));
      ASSERT_TRUE(cache.irradiance(at, up, 0.1f, vec2(0.5f), same));
      ASSERT_EQ(value, same);
      const double off = static_cast<double>(value.x) - scale, own = static_cast<double>(noise.x);
      mean += off / kLots;
      variance += off * off / kLots;
      noiseMean += own / kLots;
      noiseSquare += own * own / kLots;
    }
    EXPECT_NEAR(mean, 0.0, 0.02);
    EXPECT_NEAR(variance, scale * scale / all, 0.1 * scale * scale / all);
    EXPECT_NEAR(noiseMean, 0.0, 0.02) << before;
    EXPECT_NEAR(noiseSquare / variance, 1.0, 0.1) << before;
  }
  const std::vector<asvo::uvec4> light(model.voxels->nodes.size(), asvo::uvec4(0u));
  cache.setLight(light, scale, 100.0);
  vec3 value(1.0f), noise(1.0f);
  EXPECT_TRUE(cache.noisyIrradiance(at, vec3(0.0f, 1.0f, 0.0f), 0.1f, vec2(0.5f), 0, value, noise));
  EXPECT_EQ(noise, vec3(0.0f));
}

/// A thin plate has two sides, a corner two walls: all of it can be seen.
TEST(LightCache, PlatesAndCornersAreRead) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  test::place(scene, test::box(vec3(-1.0f), vec3(1.0f, 1.0f, -0.998f), 0, false));
  ModelOptions options;
  options.voxelDepth = 5;
  options.voxelsInTheDark = true;
  const Model model = makeModel(scene, options);
  LightCache cache(*model.voxels);
  const std::vector<asvo::uvec4> light(model.voxels->nodes.size(),
                                       asvo::uvec4(cache.tracer().asvoPackRgb9e5(vec3(1.0f))));
  cache.setLight(light, 1.0, 0.0);
  const dvec3 origin = model.rays->renderOrigin();
  for (const double side : {-1.0, 1.0}) {
    vec3 irradiance;
    EXPECT_TRUE(cache.irradiance(vec3(dvec3(0.1, 0.2, -0.999 + side * 0.001) - origin),
                                 vec3(0.0f, 0.0f, static_cast<float>(side)), 0.01f, vec2(0.5f),
                                 irradiance));
  }
}

}  // namespace
}  // namespace trex
