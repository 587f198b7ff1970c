// Which page is loaded next, and which goes: plain decisions, no threads.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/paths/page_queues.h"

namespace trex {

/// One thread at a time.
class LoadChoice {
 public:
  explicit LoadChoice(const hccm::PageTable& table);

  /// A set of paths begins, with these pages there.
  void begin(const hccm::PageCache& cache, const PageQueues& queues);
  /// The page to load now, taken to be on its way from here on; none if no ray waits for one.
  std::optional<std::uint32_t> next();
  /// It was not loaded after all.
  void putBack(std::uint32_t page);
  void loaded(std::uint32_t page);
  /// The page to give up; none if all that are there are in use.
  std::optional<std::uint32_t> victim();
  /// Rays are traced against a page, and were.
  void use(std::uint32_t page) { ++pages_[page].uses; }
  void unuse(std::uint32_t page) { --pages_[page].uses, pages_[page].last = ++clock_; }
  std::uint64_t bytesOf(std::uint32_t page) const {
    return hccm::PageCache::bytesOf(table_.pages[page]);
  }

 private:
  static constexpr std::size_t kAhead = 16;  ///< pages that are chosen at a time

  struct Page {
    std::uint32_t uses = 0;
    bool coming = false, here = false;
    std::uint64_t last = 0;  ///< use
  };
  void choose();
  void look();

  const hccm::PageTable& table_;
  const hccm::PageCache* cache_ = nullptr;
  const PageQueues* queues_ = nullptr;
  std::vector<Page> pages_;
  std::vector<std::uint32_t> here_;      ///< some of which may have gone
  std::vector<std::uint32_t> chosen_;    ///< the best last
  std::uint64_t clock_ = 0, loads_ = 0;  ///< loads_: of the cache, that are known
};

}  // namespace trex
