// Which pages of a voxel tree are on the device: a virtual memory over node indices. A page is
// 2^pageBits consecutive nodes; as nodes of a level stand in Morton order it is a compact region of
// one level, and the first pages hold the upper levels. Batches of cones mark the pages they read
// and count those they missed; what was missed most is loaded for the next batch, in place of what
// was read longest ago. Host logic alone: no Vulkan. Private to src/grays.
//
//   loads = table.begin(n)    before batch n starts; table.table() is what it sees
//   table.finished(n, marks)  once batch n has ended, in the order of the batches
//
// Several batches may be under way: a slot is given to another page only when every batch that
// could see its old page has ended. The result depends on the order of the calls and the marks
// alone. Not thread safe.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trex {

struct PageLoad {
  std::uint32_t page, slot;
};

class PageTable {
 public:
  /// At first the first pages have the slots of their numbers; the `resident` first keep them for
  /// ever. 0 < resident <= slots <= pages.
  PageTable(std::uint32_t pages, std::uint32_t slots, std::uint32_t resident);

  /// Slot of each page, or shaderio::kNoSlot.
  std::span<const std::uint32_t> table() const { return table_; }
  /// Page of each slot, or kNoPage where it is empty.
  static constexpr std::uint32_t kNoPage = 0xffffffffu;
  std::span<const std::uint32_t> pages() const { return pages_; }

  /// Makes room for pages that were missed and says which to load where, `most` at most, the most
  /// wanted first. They are in the table from now on. `batch`: numbered from 1.
  std::vector<PageLoad> begin(std::uint64_t batch, std::size_t most);
  /// What the batch did: two words a page, not 0 if it was read, and how often it was missing.
  void finished(std::uint64_t batch, std::span<const std::uint32_t> marks);

  std::uint64_t loaded() const { return loaded_; }
  std::uint64_t evicted() const { return evicted_; }
  /// Reads of voxels that a coarser one had to answer.
  std::uint64_t missedReads() const { return missed_; }

 private:
  struct FreeSlot {
    std::uint32_t slot;
    std::uint64_t lastBatch;  ///< that could see what was in it
  };
  std::vector<PageLoad> wantedPages() const;
  void evict(std::size_t count);

  std::uint32_t resident_;
  std::vector<std::uint32_t> table_, pages_;
  std::vector<std::uint64_t> lastUse_;  ///< by page: number of the last batch that read it
  std::vector<std::uint64_t> misses_;   ///< by page, since the last begin()
  std::vector<FreeSlot> free_;          ///< from the first to be used on
  std::uint64_t started_ = 0, ended_ = 0;
  std::uint64_t loaded_ = 0, evicted_ = 0, missed_ = 0;
};

}  // namespace trex
