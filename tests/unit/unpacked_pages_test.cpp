// Pages that are kept unpacked: the same pages come back, or none.
#include "hccmesh/unpacked_pages.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

#include "tests/unit/stream_meshes.h"

namespace hccm::test {
namespace {

std::vector<std::byte> bytesOf(std::uint32_t page, std::size_t size = 5000) {
  std::vector<std::byte> out(size);
  for (std::size_t i = 0; i < size; ++i) out[i] = static_cast<std::byte>(page * 31 + i * 7);
  return out;
}

bool comesBack(UnpackedPages& kept, std::uint32_t page, std::size_t size = 5000) {
  std::vector<std::byte> out(size);
  return kept.has(page) && kept.read(page, out) && out == bytesOf(page, size);
}

TEST(UnpackedPages, ComeBackAsTheyWere) {
  const auto kept = keptPages(4);
  for (const std::uint32_t page : {2u, 0u}) kept->keep(page, bytesOf(page), 1e-3);
  EXPECT_TRUE(comesBack(*kept, 0));
  EXPECT_TRUE(comesBack(*kept, 2));
  EXPECT_FALSE(kept->has(1));
  EXPECT_EQ(kept->bytes(), 10'000u);
  kept->keep(2, bytesOf(2), 1e-3);
  EXPECT_EQ(kept->bytes(), 10'000u);
}

TEST(UnpackedPages, TheirFileKeepsToItsLimit) {
  int file = 0;
  const auto kept = keptPages(9, 12'000, &file);
  for (std::uint32_t page = 0; page < 9; ++page) kept->keep(page, bytesOf(page), 1e-3);
  EXPECT_TRUE(comesBack(*kept, 1));
  EXPECT_FALSE(kept->has(2));
  EXPECT_LE(::lseek(file, 0, SEEK_END), 12'000);
}

/// What has changed, or was cut off, is forgotten; it is kept again when it has been unpacked.
TEST(UnpackedPages, DamageIsNoticed) {
  int file = 0;
  const auto kept = keptPages(3, ~0ull, &file);
  for (std::uint32_t page = 0; page < 3; ++page) kept->keep(page, bytesOf(page), 1e-3);
  const char other = 1;
  ASSERT_EQ(::pwrite(file, &other, 1, 4999), 1);
  ASSERT_EQ(::ftruncate(file, 14'000), 0);
  std::vector<std::byte> out(5000);
  EXPECT_FALSE(kept->read(0, out));
  EXPECT_FALSE(kept->has(0));
  EXPECT_TRUE(comesBack(*kept, 1));
  EXPECT_FALSE(kept->read(2, out));
  kept->keep(0, bytesOf(0), 1e-3);
  EXPECT_TRUE(comesBack(*kept, 0));
}

/// A disk that takes no more is no error.
TEST(UnpackedPages, WhatCannotBeWrittenIsNotThere) {
  UnpackedPages kept(::open("/dev/full", O_RDWR | O_CLOEXEC), ~0ull, 2, false);
  kept.keep(0, bytesOf(0), 1e-3);
  kept.keep(1, bytesOf(1), 1e-3);
  EXPECT_FALSE(kept.has(0));
  EXPECT_FALSE(kept.has(1));
  EXPECT_EQ(kept.bytes(), 0u);
}

/// Where unpacking takes no time nothing is kept.
TEST(UnpackedPages, AreKeptWhereThatPays) {
  UnpackedPages kept(::memfd_create("trex-test", MFD_CLOEXEC), ~0ull, 1000);
  for (std::uint32_t page = 0; page < 500; ++page) kept.keep(page, bytesOf(page), 0.0);
  EXPECT_FALSE(kept.has(499));
  const std::uint64_t before = kept.bytes();
  kept.keep(500, bytesOf(500), 0.0);
  EXPECT_EQ(kept.bytes(), before);
  UnpackedPages slow(::memfd_create("trex-test", MFD_CLOEXEC), ~0ull, 1000);
  for (std::uint32_t page = 0; page < 200; ++page) slow.keep(page, bytesOf(page), 10.0);
  EXPECT_TRUE(comesBack(slow, 199));
}

/// Each look at it is a step later.
ThreadMoment now_, step_;
ThreadMoment steppingClock() {
  const ThreadMoment before = now_;
  now_.now += step_.now, now_.processor += step_.processor, now_.sleeps += step_.sleeps;
  return before;
}

/// Pages that are kept as long as that pays by the clock above; each took a tenth of a millisecond.
struct Measured {
  static constexpr std::uint32_t kPages = 100'000;
  UnpackedPages kept{::memfd_create("trex-test", MFD_CLOEXEC), ~0ull, kPages, true, steppingClock};
  std::uint32_t next = 0;
  /// Whether the next page is kept.
  bool keeps() {
    kept.keep(next, bytesOf(next, 100), 1e-4);
    return kept.has(next++);
  }
};

TEST(UnpackedPages, TimeThatOthersHadTheProcessorIsNotTheDisks) {
  Measured m;
  step_ = {0.012, 1e-5, 0};  // as a quota lets go
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(m.keeps()) << i;
  std::vector<std::byte> out(100);
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(m.kept.has(5) && m.kept.read(5, out));
}

/// For as long as a disk is busy hardly any time goes into it; once it is free that is noticed.
TEST(UnpackedPages, ADiskThatWasBusyIsFoundFreeAgain) {
  Measured m;
  constexpr double kBusy = 5e-3;
  step_ = {kBusy, 1e-5, 1};
  int kept = 0;
  for (int i = 0; i < 20'000; ++i) kept += m.keeps();
  EXPECT_GT(kept, 10);
  EXPECT_LT(kept * kBusy, 0.1 * 20'000 * 1e-4);
  step_ = {2e-5, 1e-5, 0};
  int missed = 0;
  for (int i = 0; i < 20'000; ++i) missed += !m.keeps();
  EXPECT_LT(missed, 1500);
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(m.keeps());
}

TEST(UnpackedPages, WhatIsReadSlowlyIsUnpackedUntilThatIsOver) {
  Measured m;
  step_ = {2e-5, 1e-5, 0};
  while (m.next < 100) ASSERT_TRUE(m.keeps());
  std::vector<std::byte> out(100);
  const auto load = [&](std::uint32_t page) {
    if (m.kept.has(page)) return m.kept.read(page, out);
    m.kept.keep(page, bytesOf(page, 100), 1e-4);
    return false;
  };
  step_ = {1e-2, 1e-5, 1};
  int read = 0;
  for (std::uint32_t i = 0; i < 20'000; ++i) read += load(i % 100);
  EXPECT_LT(read * 1e-2, 0.15 * 20'000 * 1e-4);
  step_ = {2e-5, 1e-5, 0};
  int unpacked = 0;
  for (std::uint32_t i = 0; i < 20'000; ++i) unpacked += !load(i % 100);
  EXPECT_LT(unpacked, 2500);
}

TEST(Saving, FollowsWhatLastsAndHardlyWhatDoesNot) {
  Saving saving(1e-5);
  for (int i = 0; i < 100; ++i) saving.took(2e-5, 1.0);
  EXPECT_NEAR(saving.value(), 2e-5, 1e-6);
  saving.took(1.0, 1.0);
  EXPECT_LT(saving.value(), 3e-5);
  for (int i = 0; i < 60; ++i) saving.took(1e-2, 1.0);
  EXPECT_GT(saving.value(), 5e-3);
  EXPECT_FALSE(saving.pays(1e-3));
  for (int i = 0; i < 300; ++i) saving.without(1e-3);
  EXPECT_TRUE(saving.pays(1e-3));  // a trial
  saving.took(1e-2, 1e-3);
  EXPECT_FALSE(saving.pays(1e-3));
}

/// To unpack a page that another machine has takes its link's time, too: behind a slow one pages
/// are kept on a disk that is slow as well.
TEST(UnpackedPages, TheWayOfAPageCounts) {
  const auto keptOf = [](double bandwidth) {
    Streamed s = stream(sheet(300));
    s.pages->told = {1e-3, bandwidth};
    const auto pages = static_cast<std::uint32_t>(s.table.pages.size());
    auto kept = std::make_unique<UnpackedPages>(::memfd_create("trex-test", MFD_CLOEXEC), ~0ull,
                                                pages, true, steppingClock);
    const PagedMesh mesh = s.mesh(std::uint64_t{1} << 30, std::move(kept));
    step_ = {1.0, 1.0, 0};
    for (std::uint32_t page = 0; page < pages; ++page) mesh.page(page);
    std::uint32_t count = 0;
    for (std::uint32_t page = 0; page < pages; ++page) count += mesh.cache().isKept(page);
    return static_cast<double>(count) / pages;
  };
  EXPECT_LT(keptOf(0.0), 0.5);
  EXPECT_LT(keptOf(1e9), 0.5);
  EXPECT_EQ(keptOf(1.0), 1.0);
}

/// A thread that computes has worked, one that sleeps has waited.
TEST(ThreadClock, TellsWorkFromWaiting) {
  const ThreadMoment start = threadMoment();
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const ThreadMoment slept = threadMoment();
  EXPECT_GT(slept.sleeps, start.sleeps);
  EXPECT_GE(secondsTaken(start, slept), 5e-3);
  EXPECT_LT(slept.processor - start.processor, slept.now - start.now);
}

/// The cache gives the same hits, from the file or not, with threads that take pages from each
/// other.
TEST(UnpackedPages, ACacheThatKeepsThemHasTheSameHits) {
  Streamed a = stream(sheet(110)), b = stream(sheet(110));
  const std::uint64_t least = PageCache::leastBytes(b.table);
  const std::size_t pages = b.table.pages.size();
  const PagedMesh all = a.mesh(), few = b.mesh(3 * least, keptPages(pages));
  std::vector<std::jthread> threads;
  std::atomic<int> wrong{0};
  for (unsigned n = 0; n < 4; ++n) {
    threads.emplace_back([&, n] {
      for (std::uint32_t i = 0; i < 4 * pages; ++i) {
        const auto page = static_cast<std::uint32_t>((i * 7 + n * 3) % pages);
        const auto x = all.page(page), y = few.page(page);
        wrong += !std::ranges::equal(x.mesh().bytes(), y.mesh().bytes());
      }
    });
  }
  threads.clear();
  EXPECT_EQ(wrong, 0);
  const PageCache::Statistics s = few.statistics();
  EXPECT_GT(s.restored, pages);
  EXPECT_EQ(s.loads - s.restored, pages);
  EXPECT_LE(s.peakBytes, 3 * least);
  EXPECT_GT(s.keptBytes, 0u);
}

}  // namespace
}  // namespace hccm::test
