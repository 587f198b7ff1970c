#include "src/crays/photon_guide.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <cstring>
#include <vector>

#include "src/crays/camera_rays.h"
#include "src/frame/estimator.h"
#include "src/paths/importons.h"
#include "src/paths/photons.h"
#include "src/paths/walk_tracer.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 64;

/// A room of 4 x 4 x 4 m with a window of 0.6 m in its roof, inside a closed shell that photons
/// start outside of; the camera stands in the room.
Scene room() {
  Scene scene;
  scene.materials = {test::lambert(0.7f)};
  scene.materials[0].doubleSided = true;
  Mesh walls = test::box(vec3(-2.0f), vec3(2.0f), 0, true);
  // The roof (y = 2) is left out and comes back as four strips around the window.
  std::erase_if(walls.triangles, [&](const glm::uvec3& t) {
    return walls.positions[t.x].y > 0 && walls.positions[t.y].y > 0 && walls.positions[t.z].y > 0;
  });
  test::place(scene, walls);
  const float w = 0.3f;
  const vec4 strips[] = {{-2, -2, 2, -w}, {-2, w, 2, 2}, {-2, -w, -w, w}, {w, -w, 2, w}};
  for (const vec4& s : strips) {
    Mesh strip;
    strip.positions = {vec3(s.x, 2, s.y), vec3(s.z, 2, s.y), vec3(s.z, 2, s.w), vec3(s.x, 2, s.w)};
    strip.triangles = {{0, 2, 1}, {0, 3, 2}};
    test::place(scene, strip);
  }
  scene.cameras = {test::lookAt(dvec3(-1.5, -0.5, -1.5), dvec3(1.0, -1.0, 1.0), 1.0f)};
  return scene;
}

Scene underSky() {
  Scene scene = room();
  scene.environment.color = vec3(0.5f, 0.75f, 1.0f);
  return scene;
}

Scene underSun() {
  Scene scene = room();
  Light sun;
  sun.type = Light::Type::kDirectional;
  sun.direction = glm::normalize(vec3(0.2f, -1.0f, 0.1f));
  sun.intensity = vec3(5.0f);
  scene.lights = {sun};
  return scene;
}

Scene underMap() {
  Scene scene = room();
  auto map = std::make_shared<Image>();
  map->width = 16;
  map->height = 8;
  map->channels = 3;
  map->floats.assign(16 * 8 * 3, 0.5f);
  for (std::size_t c = 0; c < 3; ++c) map->floats[(1 * 16 + 5) * 3 + c] = 20.0f;
  scene.environment.map = map;
  scene.environment.color = vec3(1.0f);
  return scene;
}

/// What a run of batches gives, guided or not.
struct Shot {
  std::vector<LandedPhoton> landed;
  std::vector<EmissionGuide> guides;
  std::size_t wanted = 0;
};

constexpr std::uint64_t kBatch = 1u << 13, kBatches = 12;

Shot shoot(const Scene& scene, bool guided, std::uint32_t seed = 0) {
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const WalkTracer walks(rays);
  const ImportanceMap importance = traceImportons(scene, walks, camera, kSide, kSide, seed);
  Shot shot;
  shot.guides = lights.guides();
  hintGuides(scene, walks, lights, importance, shot.guides);
  for (std::uint64_t i = 0; i < kBatches; ++i) {
    if (!guided) shot.guides = lights.guides();
    const auto batch =
        landPhotons(scene, walks, lights, seed, i * kBatch, kBatch, false, shot.guides).value();
    const auto lessons = lessonsOf(batch, importance, shot.guides);
    learn(lessons, shot.guides);
    shot.wanted += lessons.size();
    shot.landed.insert(shot.landed.end(), batch.begin(), batch.end());
    for (const LandedPhoton& p : batch) {
      EXPECT_LE(maxComponent(p.power), lights.largestPhotonPower() * 1.0001f);
      EXPECT_GE(p.density, EmissionGuide::kUniformShare * 0.999f);
    }
  }
  return shot;
}

/// Power that lands on the floor inside, W, as the mean over all photons of what each brings.
Moments floorPower(const Shot& shot) {
  Moments moments;
  for (const LandedPhoton& p : shot.landed) {
    const bool floor = p.normal.y > 0.5f && std::abs(p.position.y + 2.0f) < 1e-3f;
    if (floor) moments.add(p.power);
  }
  for (std::size_t i = static_cast<std::size_t>(moments.count()); i < kBatch * kBatches; ++i) {
    moments.add(vec3(0.0f));
  }
  return moments;
}

TEST(PhotonGuide, FloorBehindAWindowGetsTheSamePowerWithLessNoise) {
  for (const Scene& scene : {underSky(), underSun(), underMap()}) {
    double plainNoise = 0.0, guidedNoise = 0.0;  // of one draw it varies twofold
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
      const Shot plain = shoot(scene, false, seed), guided = shoot(scene, true, seed);
      const Moments a = floorPower(plain), b = floorPower(guided);
      const dvec3 va = a.varianceOfMean(), vb = b.varianceOfMean();
      EXPECT_GT(a.mean().y, 0.0);
      EXPECT_NEAR(a.mean().y, b.mean().y, 4.0 * std::sqrt(va.y + vb.y));
      EXPECT_GT(guided.wanted, 5 * plain.wanted);
      plainNoise += va.y;
      guidedNoise += vb.y;
    }
    EXPECT_LT(guidedNoise, 0.25 * plainNoise);
  }
}

/// The room in a model of kilometres: photons of the uniform share, one of which may carry more
/// than all others that come in, must not be the only ones that start where nobody has looked.
TEST(PhotonGuide, ARoomInALargeModelIsNotLitByAFewPhotons) {
  for (Scene scene : {underSky(), underSun(), underMap()}) {
    for (const float x : {-1000.0f, 1000.0f}) {
      test::place(scene,
                  test::box(vec3(x - 1.0f, -1.0f, -1.0f), vec3(x + 1.0f, 1.0f, 1.0f), 0, false));
    }
    Moments power;
    for (std::uint32_t seed = 0; seed < 6; ++seed) {
      double floor = 0.0, largest = 0.0;
      for (const LandedPhoton& p : shoot(scene, true, seed).landed) {
        if (!(p.normal.y > 0.5f && std::abs(p.position.y + 2.0f) < 1e-3f)) continue;
        floor += p.power.y;
        largest = std::max<double>(largest, p.power.y);
      }
      EXPECT_GT(floor, 0.0);
      EXPECT_LT(largest, 0.25 * floor);
      power.add(vec3(static_cast<float>(floor)));
    }
    EXPECT_LT(std::sqrt(power.varianceOfMean().y * 6.0) / power.mean().y, 0.2);
  }
}

/// Guiding inwards takes photons from the outside, not power.
TEST(PhotonGuide, AllLandedPowerStaysTheSame) {
  const Shot plain = shoot(underSky(), false), guided = shoot(underSky(), true);
  Moments a, b;
  for (const LandedPhoton& p : plain.landed) a.add(p.power);
  for (const LandedPhoton& p : guided.landed) b.add(p.power);
  const double total = a.mean().y * static_cast<double>(plain.landed.size());
  EXPECT_NEAR(b.mean().y * static_cast<double>(guided.landed.size()), total, 0.03 * total);
}

TEST(PhotonGuide, SameBitsForAnyNumberOfThreads) {
  const Scene scene = underSky();
  std::vector<Shot> shots;
  for (const int threads : {1, 2, 5}) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 8);
    tbb::task_arena arena(threads);
    arena.execute([&] { shots.push_back(shoot(scene, true)); });
  }
  for (const Shot& shot : shots) {
    ASSERT_EQ(shot.landed.size(), shots[0].landed.size());
    EXPECT_EQ(shot.wanted, shots[0].wanted);
    for (std::size_t i = 0; i < shot.landed.size(); ++i) {
      const LandedPhoton &x = shot.landed[i], &y = shots[0].landed[i];
      ASSERT_EQ(x.index, y.index);
      ASSERT_EQ(x.power, y.power);
      ASSERT_EQ(x.position, y.position);
    }
  }
}

/// A guide whose density is exact: its mean over uniform points is 1, and so is that of 1/density
/// over its own.
TEST(PhotonGuide, DensityIsNormalised) {
  for (const int dimensions : {2, 4}) {
    EmissionGuide guide(dimensions);
    Sampler sampler(3, 0, 7);
    for (int i = 0; i < 5000; ++i) {
      const vec2 a = sampler.next2D(), b = sampler.next2D();
      const vec4 p(0.2f + 0.1f * a.x, a.y * a.y, dimensions == 4 ? 0.9f * b.x * b.x : 0.0f,
                   dimensions == 4 ? b.y : 0.0f);
      guide.learn(p, 1.0f, 1.0f + 3.0f * b.x);
    }
    guide.update();
    ASSERT_GT(guide.leafCount(), 50u);
    double inverse = 0.0, inside = 0.0;
    constexpr int kCount = 100000;
    for (int i = 0; i < kCount; ++i) {
      const vec2 a = sampler.next2D(), b = sampler.next2D();
      vec4 p(a.x, a.y, b.x, b.y);
      const float density = guide.warp(sampler.next1D(), p);
      EXPECT_GE(density, EmissionGuide::kUniformShare * 0.999f);
      for (int axis = 0; axis < 4; ++axis) EXPECT_TRUE(p[axis] >= 0.0f && p[axis] < 1.0f);
      inverse += 1.0 / static_cast<double>(density) / kCount;
      inside += (p.x >= 0.2f && p.x < 0.3f) / static_cast<double>(kCount);
    }
    EXPECT_NEAR(inverse, 1.0, 0.02);
    EXPECT_GT(inside, 0.6);
  }
}

/// Photons pass a small window in a large model and land in the white room behind it many times: no
/// part of the window may be lit by nothing but the uniform share, one photon of which carries what
/// hundreds of others do.
TEST(PhotonGuide, PhotonsThatLandOftenLeaveNoHoles) {
  constexpr float kWindow = 0.01f;
  constexpr int kEach = 1 << 13, kTimes = 24;
  EmissionGuide guide(2);
  Sampler sampler(7, 0, 13);
  const auto wanted = [](const vec4& p) {
    return std::max(std::abs(p.x - 0.503f), std::abs(p.y - 0.707f)) < 0.5f * kWindow;
  };
  for (int i = 0; i < 1000; ++i) {
    const vec2 a = sampler.next2D();
    guide.hint(vec4(0.503f + kWindow * (a.x - 0.5f), 0.707f + kWindow * (a.y - 0.5f), 0, 0), 1.0f);
  }
  guide.update();
  double area = 0.0;
  for (int batch = 0; batch <= kTimes; ++batch) {
    const bool last = batch == kTimes;
    const int count = last ? 1 << 18 : kEach;
    for (int i = 0; i < count; ++i) {
      vec4 p(sampler.next2D(), 0.0f, 0.0f);
      const float density = guide.warp(sampler.next1D(), p);
      if (!wanted(p)) continue;
      if (last && density > 1.0f) area += 1.0 / static_cast<double>(density) / count;
      for (int bounce = 0; !last && bounce < 6; ++bounce) guide.learn(p, density, 1.0f);
    }
    guide.update();
  }
  EXPECT_NEAR(area / (kWindow * kWindow), 1.0, 0.01);
}

TEST(PhotonGuide, KnowingNothingIsUniform) {
  EmissionGuide guide(4);
  const vec4 start(0.1f, 0.7f, 0.3f, 0.9f);
  vec4 p = start;
  guide.update();
  EXPECT_EQ(guide.warp(0.5f, p), 1.0f);
  EXPECT_EQ(p, start);
  guide.learn(start, 1.0f, 0.0f);  // not wanted: nothing is learnt
  for (int i = 0; i < 5; ++i) guide.learn(start, 1.0f, 1.0f);
  guide.update();  // too few
  EXPECT_EQ(guide.leafCount(), 0u);
}

/// All points equal: boxes shrink to a smallest size and the density stays finite.
TEST(PhotonGuide, OnePointForAll) {
  EmissionGuide guide(4);
  for (int i = 0; i < 10000; ++i) guide.hint(vec4(0.5f), 1.0f);
  guide.update();
  vec4 p(0.25f);
  const float density = guide.warp(0.5f, p);
  EXPECT_TRUE(std::isfinite(density) && density > 1.0f);
  for (int axis = 0; axis < 4; ++axis) EXPECT_NEAR(p[axis], 0.5f, 0.01f);
}

/// A camera that sees only sky wants nothing; photons then are those of no guide at all.
TEST(PhotonGuide, NothingWantedChangesNothing) {
  Scene scene = underSky();
  scene.cameras = {test::lookAt(dvec3(0, 50, 0), dvec3(0, 100, 0), 0.5f)};
  const RayScene rays(scene);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  EXPECT_TRUE(traceImportons(scene, WalkTracer(rays), camera, kSide, kSide, 0).empty());
  EXPECT_EQ(ImportanceMap().visits(vec3(0.0f), vec3(0, 1, 0)), 0.0f);
  const Shot plain = shoot(scene, false), guided = shoot(scene, true);
  EXPECT_EQ(guided.wanted, 0u);
  ASSERT_EQ(plain.landed.size(), guided.landed.size());
  for (std::size_t i = 0; i < plain.landed.size(); ++i) {
    ASSERT_EQ(plain.landed[i].power, guided.landed[i].power);
    ASSERT_EQ(plain.landed[i].position, guided.landed[i].position);
  }
}

/// Everything that the sky reaches is wanted, what is near the camera most: little harm elsewhere.
TEST(PhotonGuide, EverythingWantedCostsLittle) {
  Scene scene;
  scene.materials = {test::lambert(0.7f)};
  test::place(scene, test::box(vec3(-2.0f, -2.0f, -2.0f), vec3(2.0f, -1.9f, 2.0f), 0, false));
  test::place(scene, test::box(vec3(-0.5f, -1.9f, -0.5f), vec3(0.5f, -1.0f, 0.5f), 0, false));
  scene.environment.color = vec3(1.0f);
  scene.cameras = {test::lookAt(dvec3(4, 4, 4), dvec3(0, -1.5, 0), 1.0f)};
  const Shot plain = shoot(scene, false), guided = shoot(scene, true);
  const auto power = [](const Shot& shot) {
    Moments m;
    for (const LandedPhoton& p : shot.landed) {
      if (p.normal.y > 0.5f) m.add(p.power);
    }
    while (m.count() < kBatch * kBatches) m.add(vec3(0.0f));
    return m;
  };
  const Moments a = power(plain), b = power(guided);
  EXPECT_NEAR(a.mean().x, b.mean().x, 4.0 * std::sqrt(a.varianceOfMean().x + b.varianceOfMean().x));
  EXPECT_LT(b.varianceOfMean().x, 1.5 * a.varianceOfMean().x);
}

/// Lamps inside are none of the guides' business.
TEST(PhotonGuide, InsideSourcesHaveNoGuide) {
  const Scene scene = test::furnace(0.5f);
  const RayScene rays(scene);
  EXPECT_TRUE(LightSet(scene, rays).guides().empty());
  Scene both = scene;
  both.environment.color = vec3(1.0f);
  const LightSet lights(both, rays);
  const auto guides = lights.guides();
  ASSERT_EQ(guides.size(), 2u);
  EXPECT_EQ(guides[0].dimensions(), 0);
  EXPECT_EQ(guides[1].dimensions(), 4);
}

}  // namespace
}  // namespace trex
