// Photons: energy, order-free sums, carries, agreement of both tracers, leaks.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>

#include "tests/gpu/grays_fixture.h"

namespace trex {
namespace {

using shaderio::PhotonMaterial;
using shaderio::PhotonRecord;

std::vector<asvo::uvec4> lightOf(GRayTracer& tracer, std::span<const PhotonRecord> records,
                                 double unit) {
  tracer.tracePhotons(records, unit);
  tracer.resolveLight(records.size());
  return {tracer.light().begin(), tracer.light().end()};
}

/// Watts (red) on all sides of all leaves.
double totalFlux(const asvo::Tree& tree, std::span<const asvo::uvec4> light) {
  const asvo::Tracer tracer(tree);
  double sum = 0.0;
  for (std::uint32_t i = tree.info.firstLeaf; i < tree.info.nodeCount; ++i) {
    sum += tracer.asvoUnpackRgb9e5(light[i].x).x * tree.leafArea(i);
    sum += tracer.asvoUnpackRgb9e5(light[i].y).x * tree.leafArea(i);
  }
  return sum;
}

bool sameBits(std::span<const asvo::uvec4> a, std::span<const asvo::uvec4> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

/// A closed box whose walls lie inside voxels, not between them.
asvo::Tree whiteBox(float albedo, int depth) {
  test::Room room;
  room.addBox({0, 0, 0}, {1, 1, 1}, glm::vec3(albedo), true);
  asvo::BuildOptions options;
  options.depth = depth;
  options.lower = glm::vec3(-0.0371f);
  options.size = 1.0731f;
  return asvo::Tree::build(room, options);
}

// Albedos that 8 bits keep exactly.
constexpr float kGrey = 128.0f / 255.0f, kWhite = 230.0f / 255.0f;

struct EnergyCase {
  const char* kind;
  float albedo;
};
class Energy : public ::testing::TestWithParam<EnergyCase> {};

// In a closed box every bounce keeps the share a: deposited / emitted = 1 + a + a^2 + ...
TEST_P(Energy, ClosedBoxKeepsTheGeometricSeries) {
  const auto [kind, albedo] = GetParam();
  const asvo::Tree tree = whiteBox(albedo, 5);
  const auto tracer = test::makeTracer(kind, tree);
  const auto records = test::pointLight(tree, {0.4f, 0.6f, 0.5f}, 50.0f, 100'000);
  ASSERT_EQ(records.size(), 100'000u);
  const auto light = lightOf(*tracer, records, 1e-6);
  const double expected = 1.0 / (1.0 - double{albedo});
  const auto statistics = tracer->statistics();
  EXPECT_EQ(statistics.lostDeposits, 0u);
  const double deposits = static_cast<double>(statistics.photonDeposits) / 1e5;
  EXPECT_NEAR(deposits / expected, 1.0, 0.02);
  EXPECT_NEAR(totalFlux(tree, light) / 50.0 / expected, 1.0, 0.02);
}

// What is not deposited on the inner side of a wall has leaked.
TEST_P(Energy, NothingReachesTheOutside) {
  const auto [kind, albedo] = GetParam();
  const asvo::Tree tree = whiteBox(albedo, 5);
  const auto tracer = test::makeTracer(kind, tree);
  const auto light =
      lightOf(*tracer, test::pointLight(tree, {0.4f, 0.6f, 0.5f}, 50.0f, 20'000), 1e-6);
  const asvo::Tracer reader(tree);
  double inside = 0.0, outside = 0.0;
  for (std::uint32_t i = tree.info.firstLeaf; i < tree.info.nodeCount; ++i) {
    // Edges and corners hold several walls: only voxels of a single wall have an outside of their
    // own.
    const glm::vec3 n = glm::abs(reader.asvoNormal(i));
    if (std::max(n.x, std::max(n.y, n.z)) < 0.999f) continue;
    inside += reader.asvoUnpackRgb9e5(light[i].x).x;
    outside += reader.asvoUnpackRgb9e5(light[i].y).x;
  }
  EXPECT_GT(inside, 0.0);
  EXPECT_LT(outside, 0.002 * inside);
}

INSTANTIATE_TEST_SUITE_P(Both, Energy,
                         ::testing::Values(EnergyCase{"cpu", kGrey}, EnergyCase{"cpu", kWhite},
                                           EnergyCase{"device", kGrey},
                                           EnergyCase{"device", kWhite}),
                         [](const auto& test) {
                           return std::string(test.param.kind) +
                                  (test.param.albedo > 0.6f ? "White" : "Grey");
                         });

TEST(Photons, SumsHaveEqualBitsOnEveryRun) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 6);
  const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 50'000);
  const auto device = makeVulkanTracer(tree, {}, -1);
  const auto first = lightOf(*device, records, 1e-9);
  EXPECT_GT(totalFlux(tree, first), 0.0);
  device->resetFlux();
  EXPECT_TRUE(sameBits(first, lightOf(*device, records, 1e-9)));
  // In two parts, and on a device of its own with staged copies: the same sums.
  const auto again = test::makeTracer("staged", tree);
  again->tracePhotons(std::span(records).subspan(20'001), 1e-9);
  again->tracePhotons(std::span(records).first(20'001), 1e-9);
  again->resolveLight(records.size());
  EXPECT_TRUE(sameBits(first, again->light()));
}

TEST(Photons, WhatWasPreparedBeforeGivesTheSameLight) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 6);
  const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 20'000);
  for (const char* kind : {"cpu", "device", "staged"}) {
    const auto late = test::makeTracer(kind, tree), prepared = test::makeTracer(kind, tree);
    const auto expected = lightOf(*late, records, 1e-9);
    EXPECT_GT(totalFlux(tree, expected), 0.0);
    prepared->prepare();
    prepared->resetFlux();
    EXPECT_TRUE(sameBits(expected, lightOf(*prepared, records, 1e-9))) << kind;
    prepared->prepare();  // again, when there is flux: nothing is forgotten
    prepared->resolveLight(records.size());
    EXPECT_TRUE(sameBits(expected, prepared->light())) << kind;
    prepared->resetFlux();
    EXPECT_TRUE(sameBits(expected, lightOf(*prepared, records, 1e-9))) << kind;
  }
}

TEST(Photons, CpuSumsDoNotDependOnThreads) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 6);
  const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 20'000);
  std::vector<asvo::uvec4> lights[2];
  for (std::size_t i = 0; i < 2; ++i) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, i == 0 ? 1 : 4);
    lights[i] = lightOf(*makeCpuTracer(tree, {}), records, 1e-9);
  }
  EXPECT_TRUE(sameBits(lights[0], lights[1]));
}

TEST(Photons, DeviceAgreesWithCpu) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 5);
  const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 100'000);
  const auto cpu = makeCpuTracer(tree, {});
  const auto device = makeVulkanTracer(tree, {}, -1);
  const auto a = lightOf(*cpu, records, 1e-6), b = lightOf(*device, records, 1e-6);
  EXPECT_NEAR(totalFlux(tree, b) / totalFlux(tree, a), 1.0, 0.005);
  const double deposits = static_cast<double>(cpu->statistics().photonDeposits);
  EXPECT_NEAR(static_cast<double>(device->statistics().photonDeposits) / deposits, 1.0, 0.005);
}

// Nothing bounces off black walls, so both tracers do the same few exact steps. Counts around and
// beyond 2^32 make the low words wrap; 3e9 and 3e10 are exact in single precision.
TEST(Photons, CarriesBetweenTheTwoWordsAreExact) {
  const asvo::Tree tree = whiteBox(0.0f, 3);
  for (const float counts : {3e9f, 3e10f}) {
    std::vector<PhotonRecord> records =
        test::pointLight(tree, {0.5f, 0.5f, 0.5f}, counts * 0x1p-33f, 1);
    records.resize(1001, records[0]);
    const auto cpu = makeCpuTracer(tree, {});
    const auto device = makeVulkanTracer(tree, {}, -1);
    const auto a = lightOf(*cpu, records, 0x1p-33), b = lightOf(*device, records, 0x1p-33);
    EXPECT_TRUE(sameBits(a, b));
    // All watts of one emitted photon; rgb9e5 keeps 9 bits.
    EXPECT_NEAR(totalFlux(tree, a) / records[0].power.x, 1.0, 0.01);
  }
}

TEST(Photons, DimPowersAreNotLost) {
  const asvo::Tree tree = whiteBox(0.0f, 3);
  for (const char* kind : {"cpu", "device"}) {
    const auto tracer = test::makeTracer(kind, tree);
    // A twentieth of a count each: rounding to nearest would give nothing.
    const auto records = test::pointLight(tree, {0.5f, 0.5f, 0.5f}, 0.05f, 200'000);
    const auto light = lightOf(*tracer, records, 1.0);
    EXPECT_NEAR(totalFlux(tree, light), 0.05, 0.05 * 0.04) << kind;
  }
}

TEST(Photons, HostileRecordsAreCountedAsLost) {
  const asvo::Tree tree = whiteBox(0.5f, 4);
  auto records = test::pointLight(tree, {0.5f, 0.5f, 0.5f}, 1.0f, 6);
  records[0].power.x = std::nanf("");
  records[1].power.y = -1.0f;
  records[2].power.z = INFINITY;
  records[3].position.x = std::nanf("");
  records[4].position = glm::vec3(1e30f);
  for (const char* kind : {"cpu", "device"}) {
    const auto tracer = test::makeTracer(kind, tree);
    const auto light = lightOf(*tracer, records, 1e-6);
    EXPECT_EQ(tracer->statistics().lostDeposits, 5u) << kind;
    EXPECT_TRUE(std::isfinite(totalFlux(tree, light)));
  }
}

TEST(Photons, MetalWallsKeepTheirReflectance) {
  test::Room room;
  room.addBox({0, 0, 0}, {1, 1, 1}, glm::vec3(0.0f), true, 1);
  const asvo::Tree tree = test::buildTree(room, 5);
  // 204 / 255 = 0.8, so 1 / (1 - 0.8) = 5 deposits a photon.
  const std::vector<PhotonMaterial> materials = {{0, 1, 0, 0}, {1.0f, 0.3f, 0xffcccccc, 0}};
  const auto records = test::pointLight(tree, {0.4f, 0.6f, 0.5f}, 1.0f, 50'000);
  for (const char* kind : {"cpu", "device"}) {
    const auto tracer = test::makeTracer(kind, tree, materials);
    lightOf(*tracer, records, 1e-6);
    EXPECT_NEAR(static_cast<double>(tracer->statistics().photonDeposits) / 5e4, 5.0, 0.1) << kind;
  }
}

// Voxels that hold both faces of a wall, which lie in leaves of their own: what falls on the inner
// one counts by its own area for surface points, by that of both for cones.
TEST(Photons, FacesOfAWallShareAVoxelButNotItsLight) {
  test::Room room;
  room.addBox({0, 0, 0}, {1, 1, 1}, glm::vec3(0.0f), true);
  room.addBox({-0.05f, -0.05f, -0.05f}, {1.05f, 1.05f, 1.05f}, glm::vec3(0.0f), false);
  asvo::BuildOptions options;
  options.depth = 5;
  options.lower = glm::vec3(-0.0671f);
  options.size = 1.1342f;
  const asvo::Tree tree = asvo::Tree::build(room, options);
  const auto tracer = makeCpuTracer(tree, {});
  const auto light =
      lightOf(*tracer, test::pointLight(tree, {0.5f, 0.5f, 0.5f}, 1.0f, 50'000), 1e-7);
  const asvo::Tracer reader(tree);
  double faces = 0.0, voxel = 0.0;
  for (std::uint32_t i = tree.levelOffsets[2]; i < tree.levelOffsets[4]; ++i) {
    const auto most = [&](std::uint32_t a, std::uint32_t b) {
      return static_cast<double>(
          std::max(reader.asvoUnpackRgb9e5(a).x, reader.asvoUnpackRgb9e5(b).x));
    };
    faces += most(light[i].x, light[i].y);
    voxel += most(light[i].z, light[i].w);
  }
  EXPECT_GT(faces / voxel, 1.5);
  EXPECT_LT(faces / voxel, 2.5);
}

}  // namespace
}  // namespace trex
