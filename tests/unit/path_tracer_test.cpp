#include "src/paths/path_tracer.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "src/frame/estimator.h"
#include "src/paths/walk_tracer.h"
#include "tests/unit/glass_scenes.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 16;

/// Mean radiance of an exact picture of 16x16 pixels.
vec3 render(const Scene& scene, std::uint32_t samples, double* deviation = nullptr) {
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
  Moments all;
  for (std::uint32_t s = 0; s < samples; ++s) {
    for (std::uint32_t y = 0; y < kSide; ++y) {
      for (std::uint32_t x = 0; x < kSide; ++x) {
        all.add(tracer.sample({x, y, s}, kSide).common);
      }
    }
  }
  if (deviation) *deviation = std::sqrt(all.varianceOfMean().x);
  return vec3(all.mean());
}

TEST(PathTracer, ClosedFurnaceIsExact) {
  for (float albedo : {0.0f, 0.5f, 0.9f}) {
    const vec3 mean = render(test::furnace(albedo), 256);
    EXPECT_NEAR(mean.x * (1.0f - albedo), 1.0f, 0.004f) << albedo;
  }
}

/// A furnace with a lamp, a glass ball that bends its light, and a ball that half of the rays pass.
Scene roomOfEverything() {
  Scene scene = test::furnace(0.7f);
  scene.materials.resize(3);
  scene.materials[1].metallic = scene.materials[1].roughness = 0.0f;
  scene.materials[1].transmission = 1.0f;
  scene.materials[1].volume = true;
  scene.materials[2] = test::lambert(0.5f);
  scene.materials[2].alphaMode = AlphaMode::kBlend;
  scene.materials[2].baseColor.w = 0.5f;
  test::place(scene, test::sphere(vec3(0.6f, 0.2f, 0.0f), 0.25f, 1, 16));
  test::place(scene, test::sphere(vec3(0.5f, 0.0f, -0.4f), 0.2f, 2, 16));
  Light lamp;
  lamp.position = dvec3(0.4, 0.9, 0.1);
  lamp.intensity = vec3(3.0f, 2.0f, 1.0f);
  scene.lights = {lamp};
  return scene;
}

/// A look knows what a sample knows of its surface, but at glass, where it leaves nothing to
/// chance, and of light what is seen of emitters alone.
TEST(PathTracer, LooksShowWhatSamplesShow) {
  Scene scene = roomOfEverything();
  scene.materials.push_back(test::lambert(0.0f, 2.0f));
  scene.materials.push_back(test::lambert(0.5f));
  scene.materials.back().metallic = 1.0f, scene.materials.back().roughness = 0.0f;
  test::place(scene, test::sphere(vec3(0.3f, 0.4f, 0.3f), 0.15f, 3, 16));
  test::place(scene, test::sphere(vec3(0.6f, -0.3f, 0.3f), 0.15f, 4, 16));
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 3);
  std::vector<PathJob> looks, samples;
  for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
    looks.push_back({.x = i % kSide, .y = i / kSide, .sample = 0, .look = true});
    samples.push_back({.x = i % kSide, .y = i / kSide, .sample = 0});
  }
  const auto trace = [&](const std::vector<PathJob>& jobs, RayCounts& sum) {
    std::vector<PathSample> out(jobs.size());
    std::vector<RayCounts> counts(jobs.size());
    Cones cones;
    tracer.trace(jobs, kSide, 0, out, counts, cones);
    for (const RayCounts& c : counts) sum.add(c);
    return out;
  };
  RayCounts ofLooks, ofSamples;
  const auto seen = trace(looks, ofLooks), taken = trace(samples, ofSamples);
  EXPECT_EQ(ofLooks.shadowRays, 0u);
  EXPECT_LT(2 * ofLooks.cRays, ofSamples.cRays);
  int bright = 0, same = 0, all = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Feature &a = seen[i].feature, &b = taken[i].feature;
    if (seen[i].weight == 1.0f) ++all;
    // The random numbers of layers are other ones where light was sampled before.
    same += seen[i].weight == 1.0f && a.albedo == b.albedo && a.normal == b.normal &&
            a.position == b.position && a.footprint == b.footprint && a.black == b.black;
    if (taken[i].own == vec3(0.0f)) continue;
    ++bright;
    EXPECT_EQ(seen[i].common, taken[i].own);
  }
  EXPECT_GT(bright, 4);
  EXPECT_GT(all, static_cast<int>(seen.size() / 3));
  EXPECT_GT(same, all * 9 / 10);
}

/// Looks through a pane of glass show both of its sides in the proportion of many samples: the
/// first one alone what most of them show, in every pixel, so that there is no grain.
TEST(PathTracer, LooksLeaveNothingToChanceAtGlass) {
  Scene scene;
  scene.materials = {test::lambert(0.5f), test::glass(true)};
  test::place(scene, test::sheet(9.0f, -1.0f, 0));
  test::place(scene, test::sheet(9.0f, 3.0f, 0));
  test::place(scene, test::pane(2.0f, 0.0f, 0.01f, 1));
  scene.cameras = {test::lookAt(dvec3(0.0, 1.0, 1.5), dvec3(0.0), 0.3f)};
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 5);
  const auto behind = [&](const PathSample& p) {
    return static_cast<double>(p.feature.position.y) + rays.renderOrigin().y < 0.0;
  };
  double seen = 0.0, all = 0.0, taken = 0.0, samples = 0.0;
  constexpr std::uint32_t kSamples = 64;
  for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
    for (std::uint32_t number = 0; number < 4; ++number) {
      const PathSample p =
          tracer.sample({.x = i % kSide, .y = i / kSide, .sample = number, .look = true}, kSide);
      EXPECT_NE(p.feature.normal, vec3(0.0f));
      EXPECT_TRUE(number > 0 || behind(p));
      all += static_cast<double>(p.weight);
      if (behind(p)) seen += static_cast<double>(p.weight);
    }
    for (std::uint32_t number = 0; number < kSamples; ++number) {
      const PathSample p = tracer.sample({.x = i % kSide, .y = i / kSide, .sample = number}, kSide);
      EXPECT_EQ(p.weight, 1.0f);
      if (p.feature.normal == vec3(0.0f)) continue;  // ended by roulette
      samples += 1.0;
      taken += behind(p);
    }
  }
  constexpr double kPixels = double{kSide} * kSide;
  EXPECT_NEAR(all, 4.0 * kPixels, 0.02 * kPixels);
  EXPECT_GT(samples, 0.99 * kSamples * kPixels);
  EXPECT_GT(taken, 0.7 * samples);
  EXPECT_LT(taken, 0.95 * samples);
  EXPECT_NEAR(seen / all, taken / samples, 0.01);
}

/// What a sample is does not depend on what is traced along with it: alone, in waves that are not
/// full, in another order.
TEST(PathTracer, SamplesAreTheSameInAnyWave) {
  const Scene scene = roomOfEverything();
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const WalkTracer walks(rays);
  CausticMaps caustics(scene, walks, kSide * kSide, 3);
  caustics.prepare(std::vector<std::uint32_t>{0, 1, 2, 3, 4});
  ASSERT_NE(caustics.find(4), nullptr);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 3, true, &caustics);
  std::vector<PathJob> jobs;
  for (std::uint32_t i = 0; i < 37; ++i)
    jobs.push_back({i % kSide, i * 7 % kSide, i % 5, i % 2 == 0});
  std::vector<PathSample> samples(jobs.size());
  std::vector<RayCounts> counts(jobs.size());
  Cones cones;
  tracer.trace(jobs, kSide, 0, samples, counts, cones);
  EXPECT_TRUE(cones.requests.empty());
  std::ranges::reverse(jobs);
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    const std::size_t k = jobs.size() - 1 - i;
    const PathSample alone = tracer.sample(jobs[k], kSide);
    EXPECT_EQ(alone.common, samples[i].common) << i;
    EXPECT_EQ(alone.direct, samples[i].direct) << i;
    EXPECT_EQ(alone.feature.position, samples[i].feature.position) << i;
    EXPECT_GE(counts[i].cRays, 2u) << i;
    EXPECT_EQ(counts[i].exactPaths, jobs[k].paired ? 1u : 0u) << i;
  }
  std::vector<PathSample> reversed(jobs.size());
  std::vector<RayCounts> recounted(jobs.size());
  tracer.trace(jobs, kSide, 0, reversed, recounted, cones);
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    EXPECT_EQ(reversed[i].common, samples[jobs.size() - 1 - i].common) << i;
    EXPECT_EQ(recounted[i].shadowRays, counts[jobs.size() - 1 - i].shadowRays) << i;
  }
}

/// Of n bounces a furnace shows the first terms of its geometric sum.
TEST(PathTracer, FurnaceOfFewBouncesIsItsPartialSum) {
  for (const float albedo : {0.5f, 0.9f}) {
    float right = 0.0f, term = 1.0f;
    for (const std::uint32_t most : {0u, 1u, 2u, 3u, 4u, 5u}) {
      right += term;
      term *= albedo;
      Scene scene = test::furnace(albedo);
      scene.maxBounces = most;
      EXPECT_NEAR(render(scene, 64).x, right, 0.004f * right) << albedo << ' ' << most;
    }
  }
}

/// A mirror is a bounce; glass that light goes through is none, neither for the light that is
/// sampled nor for the path that finds it. Between a pane in a sky of 1 and a floor of albedo a the
/// light goes to and fro: with R of it reflected by the pane, L = a (1 - R) (1 + aR + (aR)^2 ...).
TEST(PathTracer, MirrorsAreBouncesAndPanesAreNone) {
  const auto plane = [](float height, float side, int material) {
    Mesh mesh;
    mesh.material = material;
    mesh.positions = {vec3(-side, height, -side), vec3(-side, height, side),
                      vec3(side, height, side), vec3(side, height, -side)};
    mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    return mesh;
  };
  Scene scene;
  scene.materials = {test::lambert(0.8f), Material{}};
  scene.materials[1].metallic = 0.0f;
  scene.materials[1].roughness = 0.0f;
  scene.materials[1].transmission = 1.0f;
  scene.environment.color = vec3(1.0f);
  scene.cameras = {test::lookAt(dvec3(0, 0.01, 0), dvec3(0.001, 0.0, 0.0), 0.1f)};
  test::place(scene, plane(0.0f, 50.0f, 0));
  test::place(scene, plane(0.02f, 50.0f, 1));
  const auto shown = [&](std::uint32_t most) {
    scene.maxBounces = most;
    return render(scene, 512).x;
  };
  EXPECT_EQ(shown(0), 0.0f);
  const float direct = shown(1), reflected = 1.0f - direct / 0.8f;
  EXPECT_GT(reflected, 0.05f);
  EXPECT_LT(reflected, 0.2f);
  EXPECT_NEAR(shown(2), direct, 0.004f);  // up to the pane and down, which a third scatters
  EXPECT_NEAR(shown(3), direct * (1.0f + 0.8f * reflected), 0.004f);
  EXPECT_NEAR(shown(Scene::kAnyBounces), direct / (1.0f - 0.8f * reflected), 0.004f);

  scene.materials[0].metallic = 1.0f;
  scene.materials[0].roughness = 0.0f;
  scene.materials[0].specularColor = vec3(1.0f);
  scene.materials[0].baseColor = vec4(1.0f);
  EXPECT_EQ(shown(0), 0.0f);
  EXPECT_GT(shown(1), 0.5f);
}

/// A sphere of albedo 1 in a uniform sky can't be seen: all that arrives leaves again.
TEST(PathTracer, WhiteSphereInASkyIsInvisible) {
  for (float roughness : {0.0f, 1.0f}) {
    Scene scene;
    scene.materials = {test::lambert(1.0f)};
    if (roughness == 0.0f) {  // a perfect mirror
      scene.materials[0].metallic = 1.0f;
      scene.materials[0].roughness = 0.0f;
    }
    test::place(scene, test::sphere(vec3(0.0f), 1.0f, 0, 32));
    scene.environment.color = vec3(0.7f);
    scene.cameras = {test::lookAt(dvec3(0, 0, 3), dvec3(0.0), 0.5f)};
    EXPECT_NEAR(render(scene, 64).x, 0.7f, 0.003f) << roughness;
  }
}

/// So is a smooth glass sphere: what is not reflected is transmitted, 1 / eta^2 in and eta^2 out.
TEST(PathTracer, ClearGlassSphereInASkyIsInvisible) {
  Scene scene;
  Material glass;
  glass.metallic = 0.0f;
  glass.roughness = 0.0f;
  glass.transmission = 1.0f;
  glass.volume = true;
  for (bool thin : {false, true}) {
    glass.volume = !thin;
    scene = Scene{};
    scene.materials = {glass};
    test::place(scene, test::sphere(vec3(0.0f), 1.0f, 0, 32));
    scene.environment.color = vec3(0.7f);
    scene.cameras = {test::lookAt(dvec3(0, 0, 3), dvec3(0.0), 0.5f)};
    EXPECT_NEAR(render(scene, 256).x, 0.7f, 0.006f) << thin;
  }
}

/// A floor under a point light: E = I cos / d^2, L = albedo E / pi.
TEST(PathTracer, PointLightOnAFloor) {
  Scene scene;
  scene.materials = {test::lambert(0.6f)};
  Mesh floor;
  floor.positions = {vec3(-5, 0, -5), vec3(-5, 0, 5), vec3(5, 0, 5), vec3(5, 0, -5)};
  floor.triangles = {{0, 1, 2}, {0, 2, 3}};
  test::place(scene, floor);
  Light light;
  light.position = dvec3(0, 2, 0);
  light.intensity = vec3(10.0f);
  scene.lights = {light};
  scene.cameras = {test::lookAt(dvec3(0, 1, 0), dvec3(0.0, 0.0, 1e-4), 0.01f)};
  EXPECT_NEAR(render(scene, 4).x, 0.6f / kPi * 10.0f / 4.0f, 1e-3f);
  scene.maxBounces = 1;
  EXPECT_NEAR(render(scene, 4).x, 0.6f / kPi * 10.0f / 4.0f, 1e-3f);
  scene.maxBounces = 0;
  EXPECT_EQ(render(scene, 4).x, 0.0f);
}

/// The same lamp found by light sampling alone, and by chance too: multiple importance sampling
/// must not change the mean where both can find it.
TEST(PathTracer, LargeLampOverAGlossyFloorAgreesWithItsMirrorLimit) {
  Scene scene;
  scene.materials = {test::lambert(0.0f, 2.0f), Material{}};
  scene.materials[1].baseColor = vec4(1.0f);
  scene.materials[1].roughness = 0.1f;
  Mesh lamp;
  lamp.positions = {vec3(-40, 3, -40), vec3(40, 3, -40), vec3(40, 3, 40), vec3(-40, 3, 40)};
  lamp.triangles = {{0, 1, 2}, {0, 2, 3}};
  Mesh floor;
  floor.material = 1;
  floor.positions = {vec3(-5, 0, -5), vec3(-5, 0, 5), vec3(5, 0, 5), vec3(5, 0, -5)};
  floor.triangles = {{0, 1, 2}, {0, 2, 3}};
  test::place(scene, lamp);
  test::place(scene, floor);
  scene.cameras = {test::lookAt(dvec3(1, 1, 1), dvec3(0.0), 0.2f)};
  // A white metal under a lamp that fills its whole lobe shows the lamp's radiance, but for the
  // small single-scattering loss of a smooth GGX lobe.
  EXPECT_NEAR(render(scene, 128).x, 2.0f, 0.02f);
}

TEST(PathTracer, AlphaCoverageLetsLightPassInProportion) {
  Scene scene;
  Material veil = test::lambert(0.0f);
  veil.alphaMode = AlphaMode::kBlend;
  veil.baseColor.w = 0.25f;
  scene.materials = {veil};
  Mesh sheet;
  sheet.positions = {vec3(-5, -5, 0), vec3(5, -5, 0), vec3(5, 5, 0), vec3(-5, 5, 0)};
  sheet.triangles = {{0, 1, 2}, {0, 2, 3}};
  test::place(scene, sheet);
  scene.environment.color = vec3(1.0f);
  scene.cameras = {test::lookAt(dvec3(0, 0, 3), dvec3(0.0), 0.3f)};
  EXPECT_NEAR(render(scene, 256).x, 0.75f, 0.01f);
}

TEST(PathTracer, EmptyViewIsTheEnvironmentAndBlackIsBlack) {
  Scene scene = test::furnace(0.5f);
  scene.materials[0] = test::lambert(0.5f);
  EXPECT_EQ(render(scene, 2), vec3(0.0f));
}

}  // namespace
}  // namespace trex
