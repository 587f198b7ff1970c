#include "src/grays/page_table.h"

#include <algorithm>
#include <cassert>
#include <numeric>

#include "src/grays/shaderio.h"

namespace trex {

PageTable::PageTable(std::uint32_t pages, std::uint32_t slots, std::uint32_t resident)
    : resident_(resident),
      table_(pages, shaderio::kNoSlot),
      pages_(slots),
      lastUse_(pages, 0),
      misses_(pages, 0) {
  assert(resident > 0 && resident <= slots && slots <= pages);
  std::iota(pages_.begin(), pages_.end(), 0u);
  std::copy(pages_.begin(), pages_.end(), table_.begin());
}

/// Pages that were missed and are not there, the most wanted first. Slots are not set.
std::vector<PageLoad> PageTable::wantedPages() const {
  std::vector<PageLoad> wanted;
  for (std::uint32_t page = 0; page < table_.size(); ++page) {
    if (misses_[page] > 0 && table_[page] == shaderio::kNoSlot) wanted.push_back({page, 0});
  }
  std::stable_sort(wanted.begin(), wanted.end(), [&](const PageLoad& a, const PageLoad& b) {
    return misses_[a.page] > misses_[b.page];
  });
  return wanted;
}

/// Takes pages out of the table, those read longest ago first, of equal ones the finer; never what
/// the last batch that ended has read.
void PageTable::evict(std::size_t count) {
  std::vector<std::uint32_t> victims;
  for (const std::uint32_t page : pages_) {
    if (page != kNoPage && page >= resident_ && lastUse_[page] < ended_) victims.push_back(page);
  }
  count = std::min(count, victims.size());
  std::sort(victims.begin(), victims.end(), [&](std::uint32_t a, std::uint32_t b) {
    return lastUse_[a] != lastUse_[b] ? lastUse_[a] < lastUse_[b] : a > b;
  });
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t slot = table_[victims[i]];
    free_.push_back({slot, started_});
    pages_[slot] = kNoPage;
    table_[victims[i]] = shaderio::kNoSlot;
  }
  evicted_ += count;
}

std::vector<PageLoad> PageTable::begin(std::uint64_t batch, std::size_t most) {
  std::vector<PageLoad> loads = wantedPages();
  std::fill(misses_.begin(), misses_.end(), 0);
  loads.resize(std::min(loads.size(), most));
  if (loads.size() > free_.size()) evict(loads.size() - free_.size());
  const auto usable = std::find_if(free_.begin(), free_.end(),
                                   [&](const FreeSlot& f) { return f.lastBatch > ended_; });
  loads.resize(std::min(loads.size(), static_cast<std::size_t>(usable - free_.begin())));
  for (std::size_t i = 0; i < loads.size(); ++i) {
    loads[i].slot = free_[i].slot;
    table_[loads[i].page] = loads[i].slot;
    pages_[loads[i].slot] = loads[i].page;
    lastUse_[loads[i].page] = batch;  // not to be thrown out before it was of use
  }
  free_.erase(free_.begin(), free_.begin() + static_cast<std::ptrdiff_t>(loads.size()));
  loaded_ += loads.size();
  started_ = batch;
  return loads;
}

void PageTable::finished(std::uint64_t batch, std::span<const std::uint32_t> marks) {
  assert(marks.size() == 2 * table_.size());
  ended_ = batch;
  for (std::size_t page = 0; page < table_.size(); ++page) {
    if (marks[2 * page] != 0) lastUse_[page] = std::max(lastUse_[page], batch);
    misses_[page] += marks[2 * page + 1];
    missed_ += marks[2 * page + 1];
  }
}

}  // namespace trex
