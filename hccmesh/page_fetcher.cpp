#include "hccmesh/page_fetcher.h"

#include <algorithm>
#include <chrono>

#include "hccmesh/page_cache.h"

namespace hccm {
namespace {

// The second keeps the way busy while the first unpacks; only one brings what nobody asked for.
constexpr std::size_t kThreads = 2;
constexpr std::size_t kMostAtOnce = 8;           // pages of a question
constexpr std::uint64_t kMostAhead = 64 * 1024;  // bytes of a question that nobody waits for

thread_local std::uint64_t missed = 0;

}  // namespace

std::uint64_t PageFetcher::missesHere() { return missed; }

PageFetcher::PageFetcher(PageCache& cache, const PageTable& table)
    : cache_(cache), table_(table), wanted_(table.pages.size()) {
  if (!cache.holdsAll()) ahead_ = static_cast<std::uint32_t>(table.pages.size());
  for (std::size_t i = 0; i < kThreads; ++i) {
    threads_.emplace_back([this, i] { work(i == 0); });
  }
}

PageFetcher::~PageFetcher() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void PageFetcher::miss(std::uint32_t page) {
  ++missed;
  ++misses_;
  if (wanted_[page].exchange(1) != 0) return;
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(page);
    ++asked_;
  }
  wake_.notify_one();
}

std::uint64_t PageFetcher::brought() const {
  const std::lock_guard lock(mutex_);
  if (problem_) std::rethrow_exception(problem_);
  return brought_;
}

void PageFetcher::await(std::uint64_t count, double seconds) const {
  std::unique_lock lock(mutex_);
  came_.wait_for(lock, std::chrono::duration<double>(seconds),
                 [&] { return brought_ >= count || problem_; });
  if (problem_) std::rethrow_exception(problem_);
}

/// A question's worth of pages that are not there and that nobody asked for. The lock is held.
std::vector<std::uint32_t> PageFetcher::pagesAhead() {
  std::vector<std::uint32_t> pages;
  for (std::uint64_t bytes = 0; ahead_ < table_.pages.size(); ++ahead_) {
    if (cache_.isHere(ahead_) || wanted_[ahead_].load() != 0) continue;
    bytes += table_.pages[ahead_].packedBytes;
    if (!pages.empty() && bytes > kMostAhead) break;
    pages.push_back(ahead_);
  }
  return pages;
}

/// Nothing at the end.
std::vector<std::uint32_t> PageFetcher::next(bool ahead) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (ends_ || problem_) return {};
    if (!queue_.empty()) break;
    if (ahead) {
      std::vector<std::uint32_t> pages = pagesAhead();
      if (!pages.empty()) return pages;
    }
    wake_.wait(lock);
  }
  // Half of what there is, so that both threads have something.
  const std::size_t count = std::clamp<std::size_t>((queue_.size() + 1) / 2, 1, kMostAtOnce);
  std::vector<std::uint32_t> pages(queue_.begin(), queue_.begin() + static_cast<long>(count));
  queue_.erase(queue_.begin(), queue_.begin() + static_cast<long>(count));
  return pages;
}

/// Those that are not there.
void PageFetcher::bring(const std::vector<std::uint32_t>& pages) {
  std::vector<std::vector<std::byte>> packed;
  std::vector<FilePart> parts;
  std::vector<std::uint32_t> absent;
  for (const std::uint32_t page : pages) {
    if (!cache_.isHere(page)) absent.push_back(page);
  }
  for (const std::uint32_t page : absent) {
    const PageEntry& entry = table_.pages[page];
    packed.emplace_back(entry.packedBytes);
    parts.push_back({entry.offset, packed.back(), entry.checksum});
  }
  cache_.file().readAll(parts);
  for (std::size_t i = 0; i < absent.size(); ++i) cache_.pin(absent[i], packed[i]).release();
}

void PageFetcher::work(bool ahead) {
  for (;;) {
    const std::vector<std::uint32_t> pages = next(ahead);
    if (pages.empty()) return;
    std::exception_ptr problem;
    try {
      bring(pages);
    } catch (...) {
      problem = std::current_exception();
    }
    const std::lock_guard lock(mutex_);
    for (const std::uint32_t page : pages) brought_ += wanted_[page].exchange(0);
    if (problem && !problem_) problem_ = problem;
    came_.notify_all();
    if (problem_) wake_.notify_all();
  }
}

}  // namespace hccm
