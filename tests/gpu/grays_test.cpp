// Gathering: the device against the C++ build of the same text, double buffering, limits, empty
// trees.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <string_view>

#include "src/core/error.h"
#include "tests/gpu/grays_fixture.h"

namespace trex {
namespace {

using shaderio::GatherQuery;
using shaderio::GatherResult;

std::vector<GatherResult> gather(GRayTracer& tracer, std::span<const GatherQuery> queries) {
  const auto results = tracer.finishGather(tracer.submitGather(queries));
  return {results.begin(), results.end()};
}

class DeviceGather : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Gather, DeviceGather, ::testing::Values("device", "staged"));

TEST_P(DeviceGather, EqualsCpu) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 7);
  const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 100'000);
  const auto queries = test::roomQueries(tree, 50'000);
  const auto cpu = makeCpuTracer(tree, {});
  const auto device = test::makeTracer(GetParam(), tree);
  for (GRayTracer* tracer : {cpu.get(), device.get()}) {
    tracer->tracePhotons(records, 1e-6);
    tracer->resolveLight(records.size());
  }
  const auto results = gather(*device, queries);
  ASSERT_EQ(results.size(), queries.size());

  // Cones are compared one by one over the light that the device's own photons left: those may take
  // other paths than the CPU's. Rounding differs, so a cone in 500 may take another cell at an
  // edge.
  const asvo::Tracer oracle(tree, device->light());
  std::size_t different = 0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    ASSERT_TRUE(std::isfinite(results[i].radiance.x) && results[i].radiance.x >= 0.0f);
    ASSERT_TRUE(results[i].transmittance >= 0.0f && results[i].transmittance <= 1.0f);
    const GatherQuery& q = queries[i];
    const bool lit = (q.flags & shaderio::kQueryShadow) == 0;
    if (!lit) {
      EXPECT_EQ(results[i].radiance, glm::vec3(0.0f));
    }
    const auto cone =
        oracle.asvoMarch(q.origin, q.direction, q.tanHalf, q.tmin, q.tmax, q.jitter, lit);
    const float scale = std::max(cone.radiance.x, 1e-3f);
    const bool same = std::abs(results[i].radiance.x - cone.radiance.x) < 0.01f * scale &&
                      std::abs(results[i].transmittance - cone.transmittance) < 1e-3f;
    different += same ? 0 : 1;
  }
  EXPECT_LE(different, results.size() / 500);

  // Photons that scatter elsewhere are noise, which all cones together average out.
  double sum = 0.0, expectedSum = 0.0;
  for (const GatherResult& r : results) sum += r.radiance.x;
  for (const GatherResult& r : gather(*cpu, queries)) expectedSum += r.radiance.x;
  EXPECT_GT(expectedSum, 0.0);
  EXPECT_NEAR(sum / expectedSum, 1.0, 2e-3);
}

// The CPU tracer reads tables; asvo::Tracer, which asks the nodes for each step, is the oracle.
TEST(Gather, CpuEqualsThePlainTracerToTheBit) {
  for (const int depth : {1, 4, 7, 8, 9}) {
    const asvo::Tree tree = test::buildTree(test::furnishedRoom(), depth);
    const auto cpu = makeCpuTracer(tree, {});
    const auto records = test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 20'000);
    cpu->tracePhotons(records, 1e-6);
    cpu->resolveLight(records.size());
    auto queries = test::roomQueries(tree, 5'000);
    for (std::size_t i = 0; i < queries.size(); i += 3) queries[i].tanHalf *= 0.01f;
    const auto results = gather(*cpu, queries);
    const asvo::Tracer oracle(tree, cpu->light());
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const GatherQuery& q = queries[i];
      const auto cone = oracle.asvoMarch(q.origin, q.direction, q.tanHalf, q.tmin, q.tmax, q.jitter,
                                         (q.flags & shaderio::kQueryShadow) == 0);
      ASSERT_EQ(results[i].radiance, cone.radiance) << "depth " << depth << ", query " << i;
      ASSERT_EQ(results[i].transmittance, cone.transmittance);
    }
  }
}

/// The furnished room with a ball of metal, which voxels know or not, and cones of which some aim
/// at it.
struct RoomWithMetal {
  static constexpr glm::vec3 kBall{2.0f, 2.2f, 1.2f};
  asvo::Tree tree;
  std::vector<GatherQuery> queries;

  explicit RoomWithMetal(bool known) {
    test::Room room = test::furnishedRoom();
    room.addSphere(kBall, 0.3f, {0.0f, 0.0f, 0.0f}, 1);
    if (known) room.setMetal(1);
    tree = test::buildTree(room, 7);
    queries = test::roomQueries(tree, 20'000);
    for (std::size_t i = 0; i < queries.size(); i += 2) {
      queries[i].direction = glm::normalize(kBall - queries[i].origin);
      if (i % 4 == 0) queries[i].tanHalf *= 0.01f;
    }
  }
  std::vector<GatherResult> gather(const char* kind) const {
    const auto tracer = test::makeTracer(kind, tree);
    tracer->tracePhotons(test::pointLight(tree, {2.0f, 2.7f, 2.8f}, 100.0f, 20'000), 1e-6);
    tracer->resolveLight(20'000);
    return trex::gather(*tracer, queries);
  }
};

/// Where a cone meets what sends light by its direction it says so; others are as they were, and
/// what asks for transmittance alone is told it.
TEST(Gather, ConesSayWhatVoxelsDoNotKnow) {
  const RoomWithMetal room(true);
  const auto plain = RoomWithMetal(false).gather("cpu"), marked = room.gather("cpu");
  const asvo::Tracer oracle(room.tree);
  int unknown = 0, known = 0;
  for (std::size_t i = 0; i < marked.size(); ++i) {
    const GatherQuery& q = room.queries[i];
    ASSERT_GE(plain[i].transmittance, 0.0f);
    const bool lit = (q.flags & shaderio::kQueryShadow) == 0;
    if (!lit || marked[i].transmittance >= 0.0f) {
      ASSERT_EQ(marked[i].radiance, plain[i].radiance) << i;
      ASSERT_EQ(marked[i].transmittance, plain[i].transmittance) << i;
    }
    asvo::Tracer::AsvoHit hit;
    if (!lit || i % 4 != 0 || !oracle.asvoIntersect(q.origin, q.direction, q.tmin, q.tmax, hit)) {
      continue;
    }
    const bool metal = oracle.asvoMaterial(hit.voxel) == 1;
    EXPECT_EQ(marked[i].transmittance < 0.0f, metal) << i;
    (metal ? unknown : known) += 1;
  }
  EXPECT_GT(unknown, 500);
  EXPECT_GT(known, 500);
}

TEST(Gather, DevicesSayTheSameOfWhatVoxelsDoNotKnow) {
  const RoomWithMetal room(true);
  const auto cpu = room.gather("cpu");
  for (const char* kind : {"device", "staged"}) {
    const auto device = room.gather(kind);
    std::size_t different = 0;
    for (std::size_t i = 0; i < cpu.size(); ++i) {
      different += std::signbit(cpu[i].transmittance) != std::signbit(device[i].transmittance);
    }
    EXPECT_LE(different, cpu.size() / 500) << kind;
  }
}

/// Cones with apertures from nothing to a half space, from outside, from faces of voxels and of the
/// cube, along the axes.
std::vector<GatherQuery> oddQueries(const asvo::Tree& tree) {
  const float edge = tree.info.size / static_cast<float>(1u << tree.info.depth);
  const glm::vec3 lower(tree.info.lowerX, tree.info.lowerY, tree.info.lowerZ);
  std::vector<GatherQuery> queries;
  for (const float tanHalf : {0.0f, 1e-20f, 0.2f, 10.0f, std::tan(1.5707964f), 1e30f}) {
    for (int way = 0; way < 27; ++way) {
      if (way == 13) continue;
      const glm::vec3 direction =
          glm::normalize(glm::vec3(way % 3 - 1, way / 3 % 3 - 1, way / 9 - 1));
      for (const float place : {-40.0f, -1.0f, 0.0f, 0.25f, 8.0f, 1e9f}) {
        const glm::vec3 origin = lower + glm::vec3(place * edge);
        queries.push_back({origin, tanHalf, direction, 0.0f, 1e30f, 0.5f, 0u, 0u});
      }
    }
  }
  return queries;
}

TEST(Gather, OddConesGiveFiniteAnswers) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 7);
  const auto queries = oddQueries(tree);
  const asvo::Tracer oracle(tree);
  for (const char* kind : {"cpu", "device"}) {
    const auto results = gather(*test::makeTracer(kind, tree), queries);
    std::size_t different = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const GatherQuery& q = queries[i];
      ASSERT_TRUE(std::isfinite(results[i].radiance.x)) << kind << ", query " << i;
      ASSERT_TRUE(results[i].transmittance >= 0.0f && results[i].transmittance <= 1.0f) << i;
      const float expected =
          oracle.asvoTransmittance(q.origin, q.direction, q.tanHalf, q.tmin, q.tmax, q.jitter);
      different += std::abs(results[i].transmittance - expected) > 1e-3f ? 1 : 0;
    }
    // Through edges and corners rounding decides which voxels a ray meets.
    EXPECT_LE(different, std::string_view(kind) == "cpu" ? 0 : queries.size() / 20) << kind;
  }
}

TEST(Gather, TwoBatchesUnderWayKeepTheirOrder) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 6);
  const auto queries = test::roomQueries(tree, 3000);
  for (const char* kind : {"cpu", "device"}) {
    const auto tracer = test::makeTracer(kind, tree);
    tracer->tracePhotons(test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 10.0f, 2000), 1e-6);
    tracer->resolveLight(2000);
    const auto all = gather(*tracer, queries);
    const std::span<const GatherQuery> span(queries);
    int ticket = tracer->submitGather(span.first(1000));
    for (std::size_t part = 0; part < 3; ++part) {
      const int next = part < 2 ? tracer->submitGather(span.subspan((part + 1) * 1000, 1000)) : -1;
      const auto results = tracer->finishGather(ticket);
      ASSERT_EQ(results.size(), 1000u);
      EXPECT_EQ(std::memcmp(results.data(), &all[part * 1000], results.size_bytes()), 0)
          << kind << ", part " << part;
      ticket = next;
    }
    EXPECT_EQ(tracer->finishGather(tracer->submitGather({})).size(), 0u);
    EXPECT_EQ(tracer->statistics().cones, 6000u);
  }
}

TEST(Gather, EmptyTreeIsClear) {
  test::Room nothing;
  for (const asvo::Tree& tree : {asvo::Tree(), asvo::Tree::build(nothing)}) {
    for (const char* kind : {"cpu", "device"}) {
      const auto tracer = test::makeTracer(kind, tree);
      const GatherQuery query{glm::vec3(0), 0.2f, glm::vec3(0, 0, 1), 0, 1e30f, 0, 0, 0};
      const auto results = gather(*tracer, {&query, 1});
      ASSERT_EQ(results.size(), 1u);
      EXPECT_EQ(results[0].transmittance, 1.0f);
      EXPECT_EQ(results[0].radiance, glm::vec3(0.0f));
      const shaderio::PhotonRecord record{glm::vec3(0), 0, glm::vec3(1), 0};
      tracer->tracePhotons({&record, 1}, 1e-6);
      tracer->resolveLight(1);
      EXPECT_EQ(tracer->statistics().lostDeposits, 1u);
      EXPECT_EQ(tracer->light().size(), tree.nodes.size());
    }
  }
}

// Smaller than the tree: pages (paged_test.cpp). Smaller than those need at least: no.
TEST(Limits, TooSmallADeviceIsRefusedBeforeAllocating) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 6);
  for (const VulkanLimits& limits :
       {VulkanLimits{.maxBytes = 1 << 17}, VulkanLimits{.maxStorageBufferRange = 1 << 13}}) {
    try {
      makeVulkanTracer(tree, {}, -1, limits);
      ADD_FAILURE() << "nothing was thrown";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kMemoryOrDevice);
      const std::string message = error.what();
      EXPECT_NE(message.find("leaves need"), std::string::npos) << message;
      EXPECT_NE(message.find("--device none"), std::string::npos) << message;
    }
  }
}

TEST(Limits, MissingDeviceNamesTheWayOut) {
  const asvo::Tree tree = test::buildTree(test::furnishedRoom(), 3);
  try {
    makeVulkanTracer(tree, {}, 99);
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::kMemoryOrDevice);
    EXPECT_NE(std::string(error.what()).find("--device none"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace trex
