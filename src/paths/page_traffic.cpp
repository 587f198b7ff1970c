#include "src/paths/page_traffic.h"

#include <algorithm>
#include <chrono>

#include "src/core/clock.h"

namespace trex {
namespace {

/// Stages let go of pages without a word, so whoever finds no room looks again after this.
constexpr std::chrono::milliseconds kLookAgain(20);

}  // namespace

PageTraffic::PageTraffic(hccm::PageCache& cache, LoadChoice& choice, PageQueues& queues,
                         std::uint64_t paths, unsigned tracing, unsigned loaders,
                         TrafficRecord* record)
    : cache_(cache),
      choice_(choice),
      queues_(queues),
      record_(record),
      announced_(queues.pages()),
      paths_(paths),
      left_(paths) {
  choice_.begin(cache, queues, record);
  for (unsigned i = 0; i < loaders; ++i)
    loaders_.emplace_back([this, n = tracing + i] { load(n); });
}

PageTraffic::~PageTraffic() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  room_.notify_all();
  for (std::thread& t : loaders_) t.join();
}

void PageTraffic::giveUp() {
  const std::lock_guard lock(mutex_);
  failLocked(nullptr);
}

void PageTraffic::fail(std::exception_ptr error) {
  const std::lock_guard lock(mutex_);
  failLocked(std::move(error));
}

void PageTraffic::failLocked(std::exception_ptr error) {
  if (!failed_) failed_ = std::move(error);
  stop_ = true;
  work_.notify_all();
  room_.notify_all();
}

void PageTraffic::rethrow() const {
  if (failed_) std::rethrow_exception(failed_);
}

// ---- threads that trace ----

/// Work that is there. The lock is held.
bool PageTraffic::takeReady(PageWork& work) {
  while (!ready_.empty()) {
    work = std::move(ready_.front());
    ready_.pop_front();
    if (work.rays.empty()) {
      announced_[work.page] = 0;
      if (!cache_.isHere(work.page)) {  // driven out: it will be loaded again
        room_.notify_all();
        continue;
      }
      queues_.take(work.page, work.rays);
      if (work.rays.empty()) continue;
      while (work.rays.size() > kAtOnce) {
        PageWork rest{.page = work.page};
        rest.rays.assign(work.rays.end() - kAtOnce, work.rays.end());
        work.rays.resize(work.rays.size() - kAtOnce);
        choice_.use(work.page);
        ready_.push_front(std::move(rest));
        if (idle_ > 0) work_.notify_one();
      }
      choice_.use(work.page);
    }
    return true;
  }
  if (next_ == paths_) return false;
  work.page = PageWork::kBegin;
  work.first = next_;
  work.end = next_ = std::min(paths_, next_ + kBegins);
  return true;
}

bool PageTraffic::next(PageWork& work, unsigned thread) {
  work.rays.clear();
  std::unique_lock lock(mutex_);
  while (left_ > 0 && !stop_) {
    if (takeReady(work)) return true;
    if (loadOne(lock, thread) || announceHere()) continue;
    const double start = secondsNow();
    ++idle_;
    work_.wait_for(lock, kLookAgain);
    --idle_;
    report_.waiting += secondsNow() - start;
  }
  return false;
}

void PageTraffic::done(const PageWork& work, const PageWorkDone& what, unsigned thread) {
  const double seconds = what.end - what.start;
  if (record_ != nullptr) record_->traced(thread, work.page, what.start, what.end);
  const std::lock_guard lock(mutex_);
  const std::size_t units =
      work.page == PageWork::kBegin ? std::size_t{work.end - work.first} : work.rays.size();
  choice_.used(work.page, units, seconds, what.waits);
  left_ -= what.ended;
  // There may be more pages to load, and more room.
  if (left_ == 0 || idle_ > 0) work_.notify_all();
  if (ready_.size() < kReady) room_.notify_all();
}

void PageTraffic::wait(std::uint32_t ray, std::uint32_t page) {
  queues_.push(page, ray);
  if (cache_.isHere(page)) announce(page);  // it came meanwhile
}

/// Rays may wait for a page that is there.
void PageTraffic::announce(std::uint32_t page) {
  const std::lock_guard lock(mutex_);
  announceLocked(page);
}

void PageTraffic::announceLocked(std::uint32_t page) {
  if (queues_.waiting(page) == 0 || announced_[page].exchange(1) != 0) return;
  ready_.push_back({.page = page});
  if (idle_ > 0) work_.notify_one();
}

/// Finds rays that wait for pages that a stage has loaded by itself. The lock is held.
bool PageTraffic::announceHere() {
  for (std::uint32_t p = 0; p < queues_.pages(); ++p) {
    if (queues_.waiting(p) > 0 && cache_.isHere(p)) announceLocked(p);
  }
  return !ready_.empty();
}

// ---- threads that load ----

/// Gives up pages until there is room. The lock is held. False if none may go now.
bool PageTraffic::makeRoom(std::uint64_t bytes) {
  while (cache_.statistics().bytes + loadingBytes_ + bytes > cache_.limit()) {
    const std::optional<std::uint32_t> page = choice_.victim();
    if (!page || !cache_.evict(*page)) return false;  // the latter: a stage reads it right now
  }
  return true;
}

/// Loads the page that is best, if there is one and room for it. The lock is held, but not
/// meanwhile.
bool PageTraffic::loadOne(std::unique_lock<std::mutex>& lock, unsigned thread) {
  if (next_ < paths_) return false;  // more is known once all paths have begun
  const std::optional<std::uint32_t> page = choice_.next();
  if (!page) return false;
  const std::uint64_t bytes = choice_.bytesOf(*page);
  if (!makeRoom(bytes)) {
    choice_.putBack(*page);
    return false;
  }
  loadingBytes_ += bytes;
  lock.unlock();
  const double start = secondsNow();
  std::exception_ptr failed;
  try {
    cache_.pin(*page);
  } catch (...) {
    failed = std::current_exception();
  }
  const double end = secondsNow();
  if (record_ != nullptr) record_->loaded(thread, *page, start, end);
  lock.lock();
  loadingBytes_ -= bytes;
  choice_.loaded(*page, end - start);
  report_.loading += end - start;
  ++report_.loads;
  if (failed) {
    failLocked(std::move(failed));
  } else {
    announceLocked(*page);
  }
  return true;
}

void PageTraffic::load(unsigned thread) {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (ready_.size() >= kReady || !loadOne(lock, thread)) room_.wait_for(lock, kLookAgain);
  }
}

}  // namespace trex
