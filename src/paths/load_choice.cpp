#include "src/paths/load_choice.h"

#include <algorithm>

namespace trex {

LoadChoice::LoadChoice(const hccm::PageTable& table) : table_(table), pages_(table.pages.size()) {}

void LoadChoice::begin(const hccm::PageCache& cache, const PageQueues& queues) {
  cache_ = &cache;
  queues_ = &queues;
  chosen_.clear();
  for (Page& p : pages_) p.uses = 0, p.coming = false;
  look();
}

/// The pages that most rays wait for.
void LoadChoice::choose() {
  struct Wanted {
    std::uint32_t rays, page;
  };
  std::vector<Wanted> wanted;
  for (std::uint32_t p = 0; p < pages_.size(); ++p) {
    const std::uint32_t rays = queues_->waiting(p);
    if (rays > 0 && !pages_[p].coming && !cache_->isHere(p)) wanted.push_back({rays, p});
  }
  const auto fuller = [](const Wanted& a, const Wanted& b) {
    return a.rays != b.rays ? a.rays > b.rays : a.page < b.page;
  };
  const std::size_t count = std::min(kAhead, wanted.size());
  std::partial_sort(wanted.begin(), wanted.begin() + static_cast<std::ptrdiff_t>(count),
                    wanted.end(), fuller);
  for (std::size_t i = count; i > 0; --i) chosen_.push_back(wanted[i - 1].page);
}

std::optional<std::uint32_t> LoadChoice::next() {
  for (int turn = 0; turn < 2; ++turn) {
    while (!chosen_.empty()) {
      const std::uint32_t page = chosen_.back();
      chosen_.pop_back();
      if (cache_->isHere(page) || queues_->waiting(page) == 0 || pages_[page].coming) continue;
      pages_[page].coming = true;
      return page;
    }
    if (turn == 0) choose();
  }
  return {};
}

void LoadChoice::putBack(std::uint32_t page) {
  pages_[page].coming = false;
  chosen_.push_back(page);
}

void LoadChoice::loaded(std::uint32_t page) {
  Page& p = pages_[page];
  p.coming = false;
  p.last = ++clock_;
  if (!p.here) here_.push_back(page);
  p.here = true;
  ++loads_;
}

/// Finds the pages that are there, those too that a stage loaded by itself.
void LoadChoice::look() {
  here_.clear();
  for (std::uint32_t p = 0; p < pages_.size(); ++p) {
    pages_[p].here = cache_->isHere(p);
    if (pages_[p].here) here_.push_back(p);
  }
  loads_ = cache_->statistics().loads;
}

/// Of the pages that no ray waits for that which was used longest ago.
std::optional<std::uint32_t> LoadChoice::victim() {
  if (cache_->statistics().loads != loads_) look();
  std::optional<std::uint32_t> best;
  for (const std::uint32_t page : here_) {
    const Page& p = pages_[page];
    if (p.uses > 0 || queues_->waiting(page) > 0 || !cache_->isHere(page)) continue;
    if (!best || p.last < pages_[*best].last) best = page;
  }
  return best;
}

}  // namespace trex
