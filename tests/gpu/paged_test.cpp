// Trees that do not fit on the device: which pages are where, the shader against the C++ build with
// the same pages, what is lost while pages are missing, limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "src/core/error.h"
#include "src/grays/page_plan.h"
#include "src/grays/page_table.h"
#include "src/grays/paged_gather.h"
#include "src/grays/tables.h"
#include "tests/gpu/grays_fixture.h"
#include "tests/gpu/paged_oracle.h"

namespace trex {
namespace {

using shaderio::GatherQuery;
using shaderio::GatherResult;
using shaderio::kNoSlot;

constexpr std::uint32_t kTestPageBits = 8;

// --- The page table -----------------------------------------------------------------------------

/// Marks of a batch that read some pages and missed others.
std::vector<std::uint32_t> marks(std::size_t pages, const std::vector<std::uint32_t>& read,
                                 const std::vector<std::uint32_t>& missed) {
  std::vector<std::uint32_t> out(2 * pages, 0);
  for (const std::uint32_t page : read) out[2 * page] = 1;
  for (const std::uint32_t page : missed) ++out[2 * page + 1];
  return out;
}

TEST(PageTable, LoadsTheMostWantedInPlaceOfTheLeastRecentlyRead) {
  PageTable table(10, 5, 2);
  EXPECT_TRUE(table.begin(1, 9).empty());
  table.finished(1, marks(10, {2, 3, 4}, {}));
  EXPECT_TRUE(table.begin(2, 9).empty());
  table.finished(2, marks(10, {2, 4}, {7, 8, 8, 8}));
  // 3 was read longest ago; 2 and 4 by the last batch, so they stay.
  const auto loads = table.begin(3, 9);
  ASSERT_EQ(loads.size(), 1u);
  EXPECT_EQ(loads[0].page, 8u);
  EXPECT_EQ(loads[0].slot, 3u);
  EXPECT_EQ(table.table()[3], kNoSlot);
  EXPECT_EQ(table.table()[8], 3u);
  EXPECT_EQ(table.loaded(), 1u);
  EXPECT_EQ(table.evicted(), 1u);
  EXPECT_EQ(table.missedReads(), 4u);
}

TEST(PageTable, ASlotIsNotGivenAwayWhileABatchMayReadIt) {
  PageTable table(6, 4, 1);
  table.begin(1, 9);
  table.begin(2, 9);
  table.finished(1, marks(6, {}, {4, 5}));
  // Batch 2 may read pages 1 to 3: two of them leave the table, nothing is loaded yet.
  EXPECT_TRUE(table.begin(3, 9).empty());
  EXPECT_EQ(table.evicted(), 2u);
  table.finished(2, marks(6, {}, {4, 5}));
  const auto loads = table.begin(4, 9);
  ASSERT_EQ(loads.size(), 2u);
  EXPECT_EQ(table.evicted(), 2u);
}

/// Any sequence of batches keeps table and slots each other's inverse and the first pages in place.
TEST(PageTable, StaysConsistent) {
  constexpr std::uint32_t kPages = 64, kSlots = 9, kResident = 3;
  PageTable table(kPages, kSlots, kResident);
  test::Random random(3);
  std::uint64_t started = 0, ended = 0;
  std::vector<std::vector<std::uint32_t>> seen;  // table of each batch under way
  for (int step = 0; step < 2000; ++step) {
    if (started - ended < 2 && random.next() < 0.6f) {
      for (const PageLoad& load : table.begin(++started, 4)) {
        for (const auto& other : seen) {
          EXPECT_EQ(std::count(other.begin(), other.end(), load.slot), 0) << "is being read";
        }
      }
      seen.emplace_back(table.table().begin(), table.table().end());
    } else if (ended < started) {
      std::vector<std::uint32_t> words(2 * kPages, 0);
      for (int i = 0; i < 12; ++i) {
        const auto page = static_cast<std::uint32_t>(random.next() * kPages);
        const bool there = seen.front()[page] != kNoSlot;
        ++words[2 * page + (there ? 0 : 1)];
      }
      table.finished(++ended, words);
      seen.erase(seen.begin());
    }
    for (std::uint32_t page = 0; page < kPages; ++page) {
      const std::uint32_t slot = table.table()[page];
      if (page < kResident) {
        ASSERT_EQ(slot, page);
      }
      if (slot != kNoSlot) {
        ASSERT_EQ(table.pages()[slot], page);
      }
    }
  }
  EXPECT_GT(table.loaded(), 100u);
}

// --- On the device ------------------------------------------------------------------------------

/// A room with light, and what the device that holds all of it answers.
struct Lit {
  asvo::Tree tree = test::buildTree(test::furnishedRoom(), 8);
  std::unique_ptr<GRayTracer> whole = makeVulkanTracer(tree, {}, -1);
  ConeTable cones{tree};
  std::vector<GatherQuery> queries = test::roomQueries(tree, 20'000);
  std::vector<GatherResult> answers;

  Lit() {
    whole->tracePhotons(test::pointLight(tree, {2.0f, 2.7f, 1.8f}, 100.0f, 50'000), 1e-6);
    whole->resolveLight(50'000);
    cones.refresh(whole->light(), {});
    const auto results = whole->finishGather(whole->submitGather(queries));
    answers.assign(results.begin(), results.end());
  }
};

const Lit& lit() {
  static const Lit made;
  return made;
}

double sum(std::span<const GatherResult> results) {
  double out = 0.0;
  for (const GatherResult& r : results) out += r.radiance.x;
  return out;
}

/// "texels", "buffers" or "staged".
class Paged : public ::testing::TestWithParam<const char*> {
 protected:
  bool is(const char* kind) const { return std::strcmp(GetParam(), kind) == 0; }
  std::unique_ptr<vulkan::Device> device(std::uint64_t maxBytes) const {
    vulkan::DeviceOptions options;
    options.maxBytes = maxBytes;
    options.forceStaging = is("staged");
    return std::make_unique<vulkan::Device>(options);
  }
  PagePlan plan(const vulkan::Device& on) const {
    return planPages(lit().tree, pageLimits(on, !is("texels")), kTestPageBits);
  }
};
INSTANTIATE_TEST_SUITE_P(Device, Paged, ::testing::Values("texels", "buffers", "staged"));

TEST_P(Paged, EqualsTheCppBuildWithTheSamePages) {
  const auto on = device(3u << 20);
  const PagePlan p = plan(*on);
  EXPECT_LT(p.slots, p.pages / 2);
  EXPECT_LE(p.bytes, on->maxBytes());
  PagedGather gather(*on, lit().tree, p);
  gather.setCones(lit().cones.words());
  const std::span<const GatherQuery> all(lit().queries);
  std::uint64_t oracleMissed = 0;
  for (std::size_t first = 0; first + 1000 <= all.size(); first += 5000) {
    const auto queries = all.subspan(first, std::min<std::size_t>(p.queries, 1000));
    const int ticket = gather.submit(queries);
    const test::PagedOracle oracle(lit().tree, p.gridLevel, lit().cones.words(),
                                   gather.pages().table(), kTestPageBits);
    const auto results = gather.finish(ticket);
    std::size_t different = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const GatherQuery& q = queries[i];
      const auto cone = oracle.asvoMarch(q.origin, q.direction, q.tanHalf, q.tmin, q.tmax, q.jitter,
                                         (q.flags & shaderio::kQueryShadow) == 0);
      const float scale = std::max(cone.radiance.x, 1e-3f);
      const bool same = std::abs(results[i].radiance.x - cone.radiance.x) < 0.01f * scale &&
                        std::abs(results[i].transmittance - cone.transmittance) < 1e-3f;
      different += same ? 0 : 1;
    }
    EXPECT_LE(different, queries.size() / 250);
    oracleMissed += oracle.missed;
  }
  const auto missed = static_cast<double>(gather.pages().missedReads());
  EXPECT_GT(missed, 0.0);
  EXPECT_NEAR(missed / static_cast<double>(oracleMissed), 1.0, 0.02);
  EXPECT_GT(gather.pages().evicted(), 0u);
  EXPECT_LE(on->allocatedBytes(), on->maxBytes());
}

/// Missing pages make answers coarser: light and what gets through stay near what they are.
TEST_P(Paged, CoarserNeverWrong) {
  const auto on = device(2u << 20);
  const PagePlan p = plan(*on);
  PagedGather gather(*on, lit().tree, p);
  gather.setCones(lit().cones.words());
  const auto results = gather.finish(gather.submit(lit().queries));  // many chunks
  ASSERT_EQ(results.size(), lit().queries.size());
  EXPECT_GT(gather.pages().missedReads(), 100u);
  double through = 0.0, expectedThrough = 0.0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    ASSERT_TRUE(std::isfinite(results[i].radiance.x) && results[i].radiance.x >= 0.0f);
    ASSERT_TRUE(results[i].transmittance >= 0.0f && results[i].transmittance <= 1.0f);
    through += results[i].transmittance;
    expectedThrough += lit().answers[i].transmittance;
  }
  const auto count = static_cast<double>(results.size());
  EXPECT_NEAR(sum(results) / sum(lit().answers), 1.0, 0.1);
  EXPECT_LT(through / count, expectedThrough / count + 0.01) << "a closed room leaks";
}

/// Three runs with two batches under way: the same bits.
TEST_P(Paged, SameBitsOnEveryRun) {
  std::vector<GatherResult> first;
  for (int run = 0; run < 3; ++run) {
    const auto on = device(2u << 20);
    PagedGather gather(*on, lit().tree, plan(*on));
    gather.setCones(lit().cones.words());
    std::vector<GatherResult> all;
    const std::span<const GatherQuery> queries(lit().queries);
    int ticket = gather.submit(queries.first(4000));
    for (std::size_t part = 1; part <= 5; ++part) {
      const int next = part < 5 ? gather.submit(queries.subspan(part * 4000, 4000)) : -1;
      const auto results = gather.finish(ticket);
      all.insert(all.end(), results.begin(), results.end());
      ticket = next;
    }
    EXPECT_GT(gather.pages().loaded(), 0u);
    if (run == 0) first = all;
    EXPECT_EQ(std::memcmp(all.data(), first.data(), all.size() * sizeof(GatherResult)), 0) << run;
  }
}

/// Once all pages that the cones read are there, the answers are those of the tree that fits.
TEST_P(Paged, EqualBitsOnceThePagesAreThere) {
  // The finest grid of cones, and most of the pages. Wide cones from a corner of the room.
  const auto on = device(64u << 20);
  PagePlan p = plan(*on);
  ASSERT_EQ(p.gridLevel, coneGridLevel(lit().tree.info));
  ASSERT_EQ(p.slots, p.pages);
  p.resident = std::min<std::uint32_t>(
      p.pages, (lit().tree.levelOffsets[p.gridLevel + 1] >> kTestPageBits) + 1);
  p.slots = p.resident + (p.pages - p.resident) / 3;
  std::vector<GatherQuery> queries;
  for (const GatherQuery& q : lit().queries) {
    if (q.origin.x < 1.0f) queries.push_back(q);
  }
  PagedGather gather(*on, lit().tree, p);
  gather.setCones(lit().cones.words());
  std::uint64_t before = 1;
  std::vector<GatherResult> results;
  for (int turn = 0; turn < 20 && gather.pages().missedReads() != before; ++turn) {
    before = gather.pages().missedReads();
    const auto found = gather.finish(gather.submit(queries));
    results.assign(found.begin(), found.end());
  }
  EXPECT_EQ(gather.pages().missedReads(), before) << "the pages never settled";
  EXPECT_GT(gather.pages().loaded(), 0u);
  const auto whole = test::makeTracer(is("texels") ? "device" : "staged", lit().tree);
  whole->tracePhotons(test::pointLight(lit().tree, {2.0f, 2.7f, 1.8f}, 100.0f, 50'000), 1e-6);
  whole->resolveLight(50'000);
  ASSERT_EQ(
      std::memcmp(whole->light().data(), lit().whole->light().data(), whole->light().size_bytes()),
      0);
  const auto expected = whole->finishGather(whole->submitGather(queries));
  EXPECT_EQ(std::memcmp(results.data(), expected.data(), expected.size_bytes()), 0);
}

// --- The tracer ---------------------------------------------------------------------------------

VulkanLimits limited(std::uint64_t bytes, bool staged = false) {
  return {.maxBytes = bytes,
          .forceStaging = staged,
          .storageBuffers = staged,
          .pageBits = kTestPageBits};
}

TEST(PagedTracer, SeesNewLight) {
  for (const bool staged : {false, true}) {
    const auto tracer = makeVulkanTracer(lit().tree, {}, -1, limited(2u << 20, staged));
    EXPECT_GT(tracer->statistics().pages, tracer->statistics().pageSlots);
    const std::span<const GatherQuery> queries = std::span(lit().queries).first(5000);
    EXPECT_EQ(sum(tracer->finishGather(tracer->submitGather(queries))), 0.0);
    tracer->tracePhotons(test::pointLight(lit().tree, {2.0f, 2.7f, 1.8f}, 100.0f, 20'000), 1e-6);
    tracer->resolveLight(20'000);
    const double once = sum(tracer->finishGather(tracer->submitGather(queries)));
    // While a batch is under way: it keeps the light it started with.
    const int ticket = tracer->submitGather(queries);
    tracer->resolveLight(10'000);  // the same flux of half as many photons
    const int next = tracer->submitGather(queries);
    EXPECT_NEAR(sum(tracer->finishGather(ticket)) / once, 1.0, 0.03);
    EXPECT_NEAR(sum(tracer->finishGather(next)) / once, 2.0, 0.06);
    EXPECT_NEAR(once / sum(std::span(lit().answers).first(5000)), 1.0, 0.1);
    tracer->refresh({});
    EXPECT_NEAR(sum(tracer->finishGather(tracer->submitGather(queries))) / once, 2.0, 0.06);
    EXPECT_EQ(tracer->statistics().cones, 25'000u);
  }
}

TEST(PagedTracer, TheSmallestLimit) {
  for (const bool staged : {false, true}) {
    vulkan::DeviceOptions options;
    options.forceStaging = staged;
    PageLimits limits = pageLimits(vulkan::Device(options), staged);
    limits.maxBytes = 1;
    const std::uint64_t least = planPages(lit().tree, limits, kTestPageBits).bytes;
    EXPECT_LT(least, 1u << 20);
    const auto tracer = makeVulkanTracer(lit().tree, {}, -1, limited(least, staged));
    tracer->tracePhotons(test::pointLight(lit().tree, {2.0f, 2.7f, 1.8f}, 100.0f, 50'000), 1e-6);
    tracer->resolveLight(50'000);
    const auto results = tracer->finishGather(tracer->submitGather(lit().queries));
    for (const GatherResult& r : results) ASSERT_TRUE(std::isfinite(r.radiance.x));
    // Voxels of an eighth of the room: a cone mostly sees the surface it starts from.
    EXPECT_NEAR(sum(results) / sum(lit().answers), 1.0, 0.5) << "neither black nor glowing";
    EXPECT_LE(tracer->statistics().deviceBytes, least);
    try {
      makeVulkanTracer(lit().tree, {}, -1, limited(least - 1, staged));
      ADD_FAILURE() << "nothing was thrown";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kMemoryOrDevice);
      EXPECT_NE(std::string(error.what()).find(std::to_string(least)), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace trex
