// Pages that are kept unpacked: the same pages come back, or none.
#include "hccmesh/unpacked_pages.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
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

TEST(UsualSeconds, FollowsWhatLastsAndHardlyWhatDoesNot) {
  UsualSeconds usual(1e-5);
  for (int i = 0; i < 100; ++i) usual.took(2e-5);
  EXPECT_NEAR(usual.value(), 2e-5, 1e-6);
  usual.took(1.0);
  EXPECT_LT(usual.value(), 3e-5);
  for (int i = 0; i < 60; ++i) usual.took(1e-2);
  EXPECT_GT(usual.value(), 5e-3);
  const double slow = usual.value();
  usual.missed();
  EXPECT_LT(usual.value(), slow);
  EXPECT_GT(usual.value(), 0.999 * slow);
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
