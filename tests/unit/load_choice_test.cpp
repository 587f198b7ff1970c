// What is loaded next, of few pages and of as many as a billion triangles have.
#include "src/paths/load_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <stdexcept>
#include <utility>

namespace trex {
namespace {

struct NoFile : hccm::PageFile {
  void read(std::uint64_t, std::span<std::byte>) const override {
    throw std::logic_error("nothing is read here");
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t) const override { return {}; }
};

/// Rays that wait for pages of which none is there, and who chooses.
struct Waiting {
  static constexpr std::uint32_t kAPage = 1000;  ///< rays, at most
  explicit Waiting(std::uint32_t pages, LoadOrder order = LoadOrder::kWaiting)
      : table(tableOf(pages)),
        cache(file, table, hccm::PageCache::leastBytes(table)),
        queues(pages, std::size_t{4} * pages + 20 * kAPage),
        choice(table, order) {
    choice.begin(cache, queues, nullptr);
  }
  static hccm::PageTable tableOf(std::uint32_t pages) {
    hccm::PageTable t;
    t.pages.resize(pages, {.packedBytes = 2000, .bytes = 4000, .triangles = 500, .clusters = 2});
    return t;
  }
  /// So many rays come to wait for a page; one must say so afterwards.
  void wait(std::uint32_t page, std::uint32_t rays) {
    for (std::uint32_t i = 0; i < rays; ++i) {
      queues.push(page, next++);
      waits.push_back(page);
    }
  }
  void say() {
    choice.used(LoadChoice::kBegin, waits.size(), 1e-5, waits);
    waits.clear();
  }
  /// The rays of the page that comes next have met it; how many there were, or 0 if none comes.
  std::uint32_t serve(std::uint32_t& page) {
    const std::optional<std::uint32_t> chosen = choice.next();
    if (!chosen) return 0;
    page = *chosen;
    choice.read(choice.bytesOf(page), 1e-5);
    choice.loaded(page, 1e-4);
    std::vector<std::uint32_t> rays;
    queues.take(page, rays);
    choice.use(page);
    choice.used(page, rays.size(), 1e-5, {});
    return static_cast<std::uint32_t>(rays.size());
  }

  NoFile file;
  hccm::PageTable table;
  hccm::PageCache cache;
  PageQueues queues;
  LoadChoice choice;
  std::uint32_t next = 0;
  std::vector<std::uint32_t> waits;
};

constexpr std::size_t kAPlan = 24;  // loads in an order of the plan's own

TEST(LoadChoice, AllPagesThatRaysWaitForComeTheFullestFirst) {
  for (const std::uint32_t pages : {40u, 3000u, 100000u}) {
    Waiting w(pages);
    std::mt19937 random(7);
    const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    std::uint32_t awaited = 0;
    for (std::uint32_t p = 0; p < pages; p += 1 + below(3), ++awaited)
      w.wait(p, 1 + (p < 10 ? Waiting::kAPage : 0) + below(4));
    w.say();
    std::vector<std::uint32_t> served;
    std::vector<char> came(pages);
    for (std::uint32_t page = 0, rays; (rays = w.serve(page)) > 0; served.push_back(rays))
      ASSERT_FALSE(std::exchange(came[page], 1)) << page << " came twice";
    EXPECT_EQ(served.size(), awaited) << pages;
    for (std::size_t i = 0; i + kAPlan < served.size(); ++i)
      ASSERT_GE(served[i], served[i + kAPlan]) << i << " of " << pages;
  }
}

TEST(LoadChoice, APageThatFillsLaterDoesNotWaitForAllOthers) {
  constexpr std::uint32_t kPages = 100000;
  Waiting w(kPages);
  for (std::uint32_t p = 0; p < kPages; p += 2) w.wait(p, 2);
  w.say();
  std::uint32_t page = 0;
  for (int i = 0; i < 1000; ++i) ASSERT_EQ(w.serve(page), 2u);
  // One that nobody waited for, and one far back among those that are waited for.
  for (const std::uint32_t p : {kPages - 1, kPages - 2}) w.wait(p, Waiting::kAPage);
  w.say();
  int found = 0, i = 0;
  for (; i < 2000 && found < 2; ++i) found += w.serve(page) >= Waiting::kAPage;
  EXPECT_EQ(found, 2);
}

TEST(LoadChoice, ARayThatComesAgainIsServedAgain) {
  Waiting w(500);
  std::uint32_t page = 0;
  for (int round = 0; round < 5; ++round) {
    for (std::uint32_t p = 0; p < 500; p += 7) w.wait(p, 3);
    w.say();
    std::uint32_t rays = 0;
    while (const std::uint32_t n = w.serve(page)) rays += n;
    EXPECT_EQ(rays, 72u * 3u) << round;
    EXPECT_EQ(w.serve(page), 0u);
  }
}

TEST(LoadChoice, RaysThatAreExpectedAreThoseThatCameOfWhatWaits) {
  Waiting w(256, LoadOrder::kPlan);  // blocks of two pages
  // Of 100 rays of page 0 half went on to page 10.
  w.wait(0, 100);
  w.say();
  std::uint32_t page = 0;
  ASSERT_EQ(w.choice.next(), 0u);
  w.choice.loaded(0, 1e-4);
  std::vector<std::uint32_t> rays;
  w.queues.take(0, rays);
  w.choice.use(0);
  w.wait(10, 50);
  w.choice.used(0, 100, 1e-5, w.waits);
  w.waits.clear();
  ASSERT_EQ(w.serve(page), 50u);
  ASSERT_EQ(page, 10u);
  // So of 60 that wait for page 0 thirty are expected there, and nobody elsewhere.
  w.wait(0, 60);
  w.say();
  ASSERT_EQ(w.choice.next(), 0u);
  EXPECT_NEAR(w.choice.expected(10), 30.0, 1e-9);
  EXPECT_EQ(w.choice.expected(100), 0.0);
}

/// Blocks go round: each gets all its pages before the next does, however many rays wait elsewhere.
TEST(LoadChoice, InTurnBlocksGoRound) {
  constexpr std::uint32_t kPages = 256;  // blocks of two
  Waiting w(kPages, LoadOrder::kInTurn);
  for (std::uint32_t p = 0; p < kPages; ++p) w.wait(p, 1 + p % 3);
  w.say();
  std::uint32_t page = 0;
  for (std::uint32_t p = 0; p < 100; ++p) {
    ASSERT_GT(w.serve(page), 0u);
    ASSERT_EQ(page, p);
  }
  w.wait(3, Waiting::kAPage);  // its turn is over
  w.say();
  for (std::uint32_t p = 100; p < kPages; ++p) {
    ASSERT_GT(w.serve(page), 0u);
    ASSERT_EQ(page, p);
  }
  EXPECT_EQ(w.serve(page), Waiting::kAPage);
  EXPECT_EQ(page, 3u);
  EXPECT_EQ(w.serve(page), 0u);
}

}  // namespace
}  // namespace trex
