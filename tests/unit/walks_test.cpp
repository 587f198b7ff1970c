// Photons, importons and photons of caustics as walks: the same bits in any wave, by any number of
// threads, and whatever pages are there when.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <cstring>
#include <optional>

#include "src/core/error.h"
#include "src/paths/caustics.h"
#include "src/paths/importons.h"
#include "src/paths/photons.h"
#include "src/paths/walk_tracer.h"
#include "tests/unit/glass_scenes.h"
#include "tests/unit/paged_scenes.h"

namespace trex {
namespace {

using test::Paged;

constexpr std::uint32_t kSide = 24;
constexpr std::uint64_t kPhotons = 4000;

/// All that walks find in a scene, as bytes.
struct Found {
  std::vector<LandedPhoton> photons;
  std::vector<ImportanceMap::Reader> readers;
  std::vector<ImportanceMap::Escape> escapes;
  std::vector<CausticPhoton> caustics;
  std::vector<float> guides;   ///< densities
  std::vector<vec3> radiance;  ///< of a map of caustics
};

/// Radiance of a map where photons have landed.
std::vector<vec3> radianceOf(const Scene& scene, const RayScene& rays, const CausticMap& map,
                             const std::vector<CausticPhoton>& photons) {
  std::vector<vec3> out;
  for (std::size_t i = 0; i < photons.size(); i += 7) {
    RayHit hit;
    const RayStart start(photons[i].position + 1e-3f * photons[i].normal);
    if (!rays.intersect(start, -photons[i].normal, 0.0f, 2e-3f, hit)) continue;
    const Surface surface = rays.surface(hit);
    const vec3 at(surface.position);
    out.push_back(map.radiance(at, map.near(at), Bsdf(scene, surface, photons[i].normal), true));
  }
  return out;
}

Found follow(const Scene& scene, const WalkTracer& walks) {
  const RayScene& rays = walks.rays();
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  Found out;
  const ImportanceMap importance = traceImportons(scene, walks, camera, kSide, kSide, 3, 1000);
  out.readers = importance.readers();
  out.escapes = importance.escapes();
  std::vector<EmissionGuide> guides = lights.guides();
  hintGuides(scene, walks, lights, importance, guides);
  for (const EmissionGuide& guide : guides) {
    for (std::uint32_t i = 0; i < 50; ++i) {
      Sampler sampler(1, i, 2);
      vec4 primary(sampler.next2D(), sampler.next2D());
      out.guides.push_back(guide.warp(sampler.next1D(), primary));
    }
  }
  out.photons = landPhotons(scene, walks, lights, 5, 100, kPhotons, true, guides).value();
  if (!CausticMaps::needed(scene)) return out;
  const CausticLights caustics(scene, walks, 7);
  out.caustics = caustics.shoot(1, 50, kPhotons);
  const CausticWidths widths(out.caustics, caustics.sceneRadius(), 6.0);
  out.radiance =
      radianceOf(scene, rays, CausticMap(scene, out.caustics, widths, 0.9f, walks), out.caustics);
  return out;
}

void expectSame(const Found& a, const Found& b) {
  ASSERT_EQ(a.photons.size(), b.photons.size());
  for (std::size_t i = 0; i < a.photons.size(); ++i) {
    const LandedPhoton &x = a.photons[i], &y = b.photons[i];
    ASSERT_EQ(x.index, y.index) << i;
    ASSERT_EQ(x.bounce, y.bounce) << i;
    ASSERT_EQ(x.position, y.position) << i;
    ASSERT_EQ(x.normal, y.normal) << i;
    ASSERT_EQ(x.power, y.power) << i;
    ASSERT_EQ(x.primary, y.primary) << i;
  }
  ASSERT_EQ(a.readers.size(), b.readers.size());
  for (std::size_t i = 0; i < a.readers.size(); ++i) {
    ASSERT_EQ(a.readers[i].start.position, b.readers[i].start.position) << i;
    ASSERT_EQ(a.readers[i].visits, b.readers[i].visits) << i;
  }
  ASSERT_EQ(a.escapes.size(), b.escapes.size());
  for (std::size_t i = 0; i < a.escapes.size(); ++i) {
    ASSERT_EQ(a.escapes[i].origin, b.escapes[i].origin) << i;
    ASSERT_EQ(a.escapes[i].direction, b.escapes[i].direction) << i;
  }
  ASSERT_EQ(a.guides, b.guides);
  ASSERT_EQ(a.caustics.size(), b.caustics.size());
  for (std::size_t i = 0; i < a.caustics.size(); ++i) {
    ASSERT_EQ(a.caustics[i].position, b.caustics[i].position) << i;
    ASSERT_EQ(a.caustics[i].power, b.caustics[i].power) << i;
  }
  ASSERT_EQ(a.radiance, b.radiance);
}

/// Glass, a layer that half of the rays pass, a mirror, and what is smooth and scatters.
std::vector<Material> allKinds() {
  std::vector<Material> materials = {test::lambert(0.6f), test::lambert(0.5f), Material{},
                                     Material{}};
  materials[1].alphaMode = AlphaMode::kBlend;
  materials[1].baseColor.w = 0.5f;
  materials[2] = test::glass(false);
  materials[3].roughness = 0.0f;
  return materials;
}

/// Under a sky, a sun and a lamp.
Paged everything(std::uint64_t pages) {
  Paged model = test::paged(allKinds(), pages, true);
  model.scene.lights.push_back(test::sun(vec3(0.3f, 0.2f, -1.0f), 2.0f));
  return model;
}

void expectMuch(const Found& found) {
  EXPECT_GT(found.photons.size(), 400u);
  EXPECT_GT(found.readers.size(), 100u);
  EXPECT_GT(found.escapes.size(), 50u);
  EXPECT_GT(found.caustics.size(), 100u);
  EXPECT_GT(found.radiance.size(), 10u);
}

TEST(Walks, FindTheSameInAnyWaveAndByAnyNumberOfThreads) {
  const Paged model = everything(10'000);
  const Found alone = follow(model.scene, WalkTracer(*model.rays, 1));
  expectMuch(alone);
  for (const std::size_t wave : {3, 16}) {
    for (const int threads : {1, 4}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 8);
      tbb::task_arena(threads).execute(
          [&] { expectSame(follow(model.scene, WalkTracer(*model.rays, wave)), alone); });
    }
  }
}

/// The same in memory, where rays of a wave are packets: with media, which scatter photons.
TEST(Walks, FindTheSameInPackets) {
  Scene scene = test::furnace(0.7f);
  scene.materials.push_back(test::glass(true));
  scene.materials.push_back(test::lambert(0.5f));
  test::place(scene, test::sphere(vec3(0.5f, 0.1f, 0.0f), 0.25f, 1, 16));
  scene.lights = {test::pointLight(dvec3(0.2, 0.8, 0.1), 3.0f),
                  test::sun(vec3(0.1f, -1.0f, 0.2f), 2.0f)};
  scene.materials[0].doubleSided = true;
  const RayScene rays(scene);
  const Found alone = follow(scene, WalkTracer(rays, 1));
  EXPECT_GT(alone.photons.size(), kPhotons);
  expectSame(follow(scene, WalkTracer(rays, 5)), alone);
  expectSame(follow(scene, WalkTracer(rays)), alone);
}

TEST(Walks, FindTheSameWhereTheyWaitForPages) {
  const Found whole = [] {
    const Paged model = everything(10'000);
    return follow(model.scene, WalkTracer(*model.rays));
  }();
  for (const std::uint64_t pages : {1, 3, 10'000}) {
    for (const int threads : {1, 3}) {
      // The latter: so little that few walks are under way at once.
      for (const std::uint64_t bytes : {std::uint64_t{1} << 24, std::uint64_t{1}}) {
        const Paged model = everything(pages);
        LoadChoice choice(model.mesh().table());
        const WalkTracer walks(*model.rays, choice, bytes);
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 8);
        tbb::task_arena(threads).execute([&] { expectSame(follow(model.scene, walks), whole); });
        EXPECT_LE(model.cache().statistics().peakBytes, model.cache().limit());
        EXPECT_GT(walks.report().loads, 0u);
      }
    }
  }
}

/// Loads that walks share: many fewer than if each thread loads what its ray needs.
TEST(Walks, ShareLoads) {
  std::uint64_t loads[2];
  for (const bool wait : {false, true}) {
    const Paged model = test::paged({test::lambert(0.6f), test::lambert(0.3f)}, 2, true);
    LoadChoice choice(model.mesh().table());
    const WalkTracer walks =
        wait ? WalkTracer(*model.rays, choice, std::uint64_t{1} << 24) : WalkTracer(*model.rays);
    follow(model.scene, walks);
    loads[wait] = model.cache().statistics().loads;
    if (wait) {
      EXPECT_EQ(walks.report().loads, loads[wait]);  // no stage loads by itself
    }
  }
  EXPECT_LT(8 * loads[1], loads[0]);
}

TEST(Walks, PhotonsMayBeGivenUp) {
  const Paged model = test::paged({test::lambert(0.6f)}, 1);
  const LightSet lights(model.scene, *model.rays);
  LoadChoice choice(model.mesh().table());
  const WalkTracer walks(*model.rays, choice, 1u << 24);
  std::atomic<int> asked{0};
  const auto land = [&](int most) {
    return landPhotons(model.scene, walks, lights, 5, 0, kPhotons, true, {},
                       [&, most] { return ++asked > most; });
  };
  EXPECT_FALSE(land(10));
  EXPECT_TRUE(land(1'000'000));
}

TEST(Walks, APageThatCannotBeReadIsAnError) {
  const Paged model = test::paged({test::lambert(0.6f)}, 3, false, true);
  const LightSet lights(model.scene, *model.rays);
  LoadChoice choice(model.mesh().table());
  const WalkTracer walks(*model.rays, choice, 1u << 24);
  try {
    landPhotons(model.scene, walks, lights, 5, 0, kPhotons, true);
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
    EXPECT_NE(std::string(e.what()).find("can't be read"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace trex
