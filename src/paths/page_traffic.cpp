#include "src/paths/page_traffic.h"

#include <algorithm>
#include <chrono>

#include "src/core/clock.h"

namespace trex {
namespace {

/// Stages let go of pages without a word, so whoever finds no room looks again after this.
constexpr std::chrono::milliseconds kLookAgain(20);

}  // namespace

PageTraffic::PageTraffic(const hccm::PagedMesh& mesh, LoadChoice& choice, PageQueues& queues,
                         std::uint64_t paths, unsigned readers, TrafficRecord* record)
    : mesh_(mesh),
      cache_(mesh.cache()),
      choice_(choice),
      queues_(queues),
      record_(record),
      announced_(queues.pages()),
      paths_(paths),
      left_(paths),
      atOnce_(std::max(cache_.file().partsAtOnce(), 1u)),
      packedLimit_(cache_.limit() / kPackedShare) {
  for (const hccm::PageEntry& page : mesh.table().pages)
    largest_ = std::max<std::uint64_t>(largest_, page.packedBytes);
  packedLimit_ = std::max(packedLimit_, largest_ * readers * atOnce_);
  choice_.begin(cache_, queues, record);
  for (unsigned i = 0; i < readers; ++i) readers_.emplace_back([this, i] { read(i); });
}

PageTraffic::~PageTraffic() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  disk_.notify_all();
  for (std::thread& t : readers_) t.join();
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
  disk_.notify_all();
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
        wakeReader();
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
    if (unpackOne(lock, thread) || takeKept() || readHere(lock, thread) || announceHere()) continue;
    wakeReader();
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
  report_.waiting += what.waited;
  report_.rays += what.rays;
  report_.waits += what.waits.size();
  // There may be more room for pages.
  if (left_ == 0 || idle_ > 0) work_.notify_all();
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

/// There may be something to read, or room for it. The lock is held.
void PageTraffic::wakeReader() {
  if (choice_.readsAhead()) disk_.notify_one();
}

/// Finds rays that wait for pages that a stage has loaded by itself: at once if the cache knows of
/// more loads than before, now and then in any case, as counts do not tell of all. The lock is
/// held.
bool PageTraffic::announceHere() {
  const std::uint64_t loads = cache_.statistics().loads - report_.loads;
  const double now = secondsNow();
  if (loads == loadsOfStages_ && now < lookedHere_ + 1e-3 * kLookAgain.count()) return false;
  loadsOfStages_ = loads, lookedHere_ = now;
  for (std::uint32_t p = 0; p < queues_.pages(); ++p) {
    if (queues_.waiting(p) > 0 && cache_.isHere(p)) announceLocked(p);
  }
  return !ready_.empty();
}

// ---- threads that trace unpack pages that were read ----

/// Gives up pages until there is room. The lock is held. False if none may go now.
bool PageTraffic::makeRoom(std::uint64_t bytes) {
  while (cache_.statistics().bytes + unpackingBytes_ + bytes > cache_.limit()) {
    const std::optional<std::uint32_t> page = choice_.victim();
    if (!page || !cache_.evict(*page)) return false;  // the latter: a stage reads it right now
  }
  return true;
}

/// The page to read next need not be read: it is as if it had been. The lock is held.
bool PageTraffic::takeKept() {
  want();
  if (!wanted_ || !cache_.isKept(*wanted_)) return false;
  for (std::size_t i = packed_.size(); i > 0 && kept_ == kMostKept; --i) {
    if (packed_[i - 1].kept && queues_.waiting(packed_[i - 1].page) == 0) drop(i - 1);
  }
  if (kept_ == kMostKept) return false;
  packed_.push_back({*wanted_, false, {}, true});
  wanted_.reset();
  ++kept_;
  return true;
}

/// The lock is held.
void PageTraffic::want() {
  if (wanted_) return;
  choice_.toBegin(paths_ - next_);
  wanted_ = choice_.next();
  if (wanted_ && !cache_.isKept(*wanted_)) wakeReader();
}

/// Unpacks the page that is worth most, if rays wait for one that was read and there is room for
/// it. The lock is held, but not meanwhile.
bool PageTraffic::unpackOne(std::unique_lock<std::mutex>& lock, unsigned thread) {
  std::size_t best = packed_.size();
  double most = 0.0;
  for (std::size_t i = 0; i < packed_.size(); ++i) {
    const double worth = choice_.worth(packed_[i].page);
    if (worth > most) most = worth, best = i;
  }
  if (best == packed_.size()) return false;
  const std::uint32_t page = packed_[best].page;
  const std::uint64_t bytes = choice_.bytesOf(page);
  if (!cache_.isHere(page) && !makeRoom(bytes)) return false;
  Packed packed = std::move(packed_[best]);
  if (best + 1 < packed_.size()) packed_[best] = std::move(packed_.back());
  packed_.pop_back();
  unpackingBytes_ += bytes;
  kept_ -= packed.kept;
  lock.unlock();
  const double start = secondsNow();
  std::exception_ptr failed;
  try {
    cache_.pin(page, packed.bytes);
  } catch (...) {
    failed = std::current_exception();
  }
  const double end = secondsNow();
  if (record_ != nullptr) record_->loaded(thread, page, start, end);
  lock.lock();
  unpackingBytes_ -= bytes;
  packedBytes_ -= packed.bytes.size();
  if (!packed.kept) spare_.push_back(std::move(packed.bytes));
  choice_.loaded(page, end - start, packed.kept);
  interval_ += 0.1 * (std::clamp(end - unpacked_, 1e-6, 1.0) - interval_);
  unpacked_ = end;
  report_.unpacking += end - start;
  ++report_.loads;
  report_.readAhead += packed.ahead;
  if (!packed.kept) report_.planned += choice_.packedBytesOf(page);
  if (!packed.kept) wakeReader();  // there is room for another
  if (failed) {
    failLocked(std::move(failed));
  } else {
    announceLocked(page);
  }
  return true;
}

// ---- threads that read ----

/// Forgets a page that was read.
void PageTraffic::drop(std::size_t place) {
  choice_.putBack(packed_[place].page);
  packedBytes_ -= packed_[place].bytes.size();
  kept_ -= packed_[place].kept;
  if (!packed_[place].kept) ++report_.readInVain;
  if (place + 1 < packed_.size()) packed_[place] = std::move(packed_.back());
  packed_.pop_back();
}

/// Whether a page that rays wait for has room among those that were read; those that none waits for
/// go for it, where least are expected first.
bool PageTraffic::fits(std::uint64_t bytes) {
  while (packedBytes_ > 0 && packedBytes_ + bytes > packedLimit_) {
    std::size_t least = packed_.size();
    for (std::size_t i = 0; i < packed_.size(); ++i) {
      if (queues_.waiting(packed_[i].page) > 0) continue;
      if (least == packed_.size() ||
          choice_.expected(packed_[i].page) < choice_.expected(packed_[least].page))
        least = i;
    }
    if (least == packed_.size()) return false;
    drop(least);
  }
  return true;
}

/// Pages that are read and not yet unpacked, as many as will be needed while the next is read: what
/// is chosen later is chosen better.
std::size_t PageTraffic::depth() const {
  if (next_ < paths_) return packed_.size() + reading_ + 1;  // there is time
  return 2 * atOnce_ * readers_.size() +
         static_cast<std::size_t>(kAhead * choice_.readSeconds() / interval_);
}

/// What to read now. The lock is held.
std::optional<PageTraffic::Packed> PageTraffic::toRead(bool mayBeAhead) {
  std::size_t wanted = reading_;
  for (const Packed& p : packed_) wanted += queues_.waiting(p.page) > 0;
  if (wanted >= depth()) return {};
  while (takeKept()) {
    if (idle_ > 0) work_.notify_one();
  }
  if (wanted_) {
    const std::uint32_t page = *wanted_;
    if (cache_.isKept(page)) return {};  // as many as can be are to be taken already
    const std::uint64_t bytes = choice_.packedBytesOf(page);
    if (!fits(bytes)) return {};
    wanted_.reset();
    packedBytes_ += bytes;
    ++reading_;
    return Packed{page, false, {}};
  }
  // What nobody waits for yet drives nothing out.
  if (!mayBeAhead || packedBytes_ + largest_ > packedLimit_) return {};
  const std::optional<std::uint32_t> page = choice_.ahead();
  if (!page) return {};
  packedBytes_ += choice_.packedBytesOf(*page);
  ++reading_;
  return Packed{*page, true, {}};
}

/// What to read together. The lock is held.
void PageTraffic::takeToRead(std::vector<Packed>& some) {
  some.clear();
  while (choice_.readsAhead() && some.size() < atOnce_) {
    std::optional<Packed> next = toRead(true);
    if (!next) return;
    some.push_back(std::move(*next));
  }
}

/// The lock is held, but not meanwhile. Seconds that it took.
PageTraffic::Span PageTraffic::readThese(std::unique_lock<std::mutex>& lock,
                                         std::span<Packed> some) {
  for (std::size_t i = 0; i < some.size() && !spare_.empty(); ++i) {
    some[i].bytes = std::move(spare_.back());
    spare_.pop_back();
  }
  lock.unlock();
  std::uint64_t bytes = 0;
  std::vector<hccm::FilePart> parts;
  for (Packed& p : some) {
    const hccm::PageEntry& entry = mesh_.table().pages[p.page];
    p.bytes.resize(entry.packedBytes);
    parts.push_back({entry.offset, p.bytes, entry.checksum});
    bytes += choice_.bytesOf(p.page);
  }
  const double start = secondsNow();
  std::exception_ptr failed;
  try {
    cache_.file().readAll(parts);
  } catch (...) {
    failed = std::current_exception();
  }
  const double end = secondsNow();
  lock.lock();
  reading_ -= some.size();
  choice_.read(bytes, end - start);
  report_.reading += end - start;
  if (failed) {
    failLocked(std::move(failed));
  } else {
    for (Packed& p : some) packed_.push_back(std::move(p));
    if (idle_ > 0) work_.notify_one();
  }
  return {start, end};
}

/// A thread without rays reads by itself what comes at once. False if there is nothing.
bool PageTraffic::readHere(std::unique_lock<std::mutex>& lock, unsigned thread) {
  if (choice_.readsAhead()) return false;
  std::optional<Packed> next = toRead(false);
  if (!next) return false;
  const std::uint32_t page = next->page;
  const Span span = readThese(lock, {&*next, 1});
  report_.waiting += span.end - span.start;
  if (record_ != nullptr) record_->loaded(thread, page, span.start, span.end);
  return true;
}

/// One reading thread looks for itself whether there is something to read; it wakes the others.
void PageTraffic::read(unsigned reader) {
  std::unique_lock lock(mutex_);
  std::vector<Packed> some;
  std::vector<std::uint32_t> pages;
  while (!stop_) {
    takeToRead(some);
    if (!some.empty()) {
      disk_.notify_one();
      pages.clear();
      for (const Packed& p : some) pages.push_back(p.page);
      const Span span = readThese(lock, some);
      if (record_ == nullptr) continue;
      for (const std::uint32_t page : pages) record_->read(reader, page, span.start, span.end);
    } else if (reader == 0) {
      if (disk_.wait_for(lock, kLookAgain) == std::cv_status::timeout) choice_.lookAgain();
    } else {
      disk_.wait(lock);
    }
  }
}

}  // namespace trex
