// Between rays that wait and pages that come: threads that load, and what is ready to be traced.
//
//   rays ─► PageQueues ─► LoadChoice: which page next, which goes ─► loading threads ─► PageCache
//                │                                                        │
//                └──────── work: rays of a page that is there ◄───────────┘
//
// Pages are loaded while rays are traced. A page stays as long as rays wait for it or are traced
// against it (but a stage that loads on demand may drive it out: then its rays wait again).
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/paths/load_choice.h"
#include "src/paths/page_queues.h"

namespace trex {

/// What it did so far. Seconds of threads, added up.
struct PageTrafficReport {
  double tracing = 0.0;  ///< threads that trace, waits included
  double waiting = 0.0;  ///< of these, for pages
  double loading = 0.0;
  std::uint64_t loads = 0;
  void add(const PageTrafficReport& o) {
    tracing += o.tracing, waiting += o.waiting, loading += o.loading, loads += o.loads;
  }
};

/// Rays of one page, or paths to begin.
struct PageWork {
  static constexpr std::uint32_t kBegin = LoadChoice::kBegin;
  std::uint32_t page = kBegin;
  std::vector<std::uint32_t> rays{};
  std::uint64_t first = 0, end = 0;  ///< kBegin: the paths
};

/// What became of it.
struct PageWorkDone {
  double start = 0.0, end = 0.0;       ///< secondsNow()
  std::uint64_t ended = 0;             ///< paths
  std::vector<std::uint32_t> waits{};  ///< pages that rays wait for now, one each
};

/// For one set of paths. Threads that trace call next() and done(); its own ones load.
class PageTraffic {
 public:
  /// `paths` are numbers [0, paths) that are to begin, as there is room for them.
  /// `tracing` threads call next(), `loaders` are its own. `record` may be null.
  PageTraffic(hccm::PageCache& cache, LoadChoice& choice, PageQueues& queues, std::uint64_t paths,
              unsigned tracing, unsigned loaders, TrafficRecord* record);
  /// Ends the loading threads.
  ~PageTraffic();
  PageTraffic(const PageTraffic&) = delete;
  PageTraffic& operator=(const PageTraffic&) = delete;

  /// Work for a thread that traces; waits for a page if there is none. False when all paths have
  /// ended, or a page can't be loaded, or after giveUp().
  bool next(PageWork& work, unsigned thread);
  /// The work of next() is done.
  void done(const PageWork& work, const PageWorkDone& what, unsigned thread);
  /// A ray waits for a page. Any thread.
  void wait(std::uint32_t ray, std::uint32_t page);
  /// A thread that traces has failed: all end. Any thread.
  void fail(std::exception_ptr error);
  /// All threads end where they are. Any thread.
  void giveUp();
  /// Whether paths have not ended.
  bool gaveUp() const { return left_ > 0; }
  /// Throws what a page that can't be loaded threw.
  void rethrow() const;
  PageTrafficReport report() const { return report_; }

 private:
  static constexpr std::size_t kAtOnce = 512;    ///< rays of a piece of work
  static constexpr std::uint64_t kBegins = 256;  ///< paths that begin at once

  static constexpr std::size_t kReady = 8;  ///< pieces of work that need no more beside them

  void load(unsigned thread);
  bool loadOne(std::unique_lock<std::mutex>& lock, unsigned thread);
  bool makeRoom(std::uint64_t bytes);
  void announce(std::uint32_t page);
  bool announceHere();
  void announceLocked(std::uint32_t page);
  void failLocked(std::exception_ptr error);
  bool takeReady(PageWork& work);

  hccm::PageCache& cache_;
  LoadChoice& choice_;
  PageQueues& queues_;
  TrafficRecord* record_;
  std::vector<std::atomic<std::uint8_t>> announced_;  ///< by page: it is in ready_
  std::mutex mutex_;                                  ///< of all below
  std::condition_variable work_, room_;
  std::deque<PageWork> ready_;  ///< of pages alone: their queues are to be taken
  std::uint64_t next_ = 0, paths_, left_;
  std::uint64_t loadingBytes_ = 0;
  int idle_ = 0;  ///< threads that trace and have nothing to do
  bool stop_ = false;
  std::exception_ptr failed_;
  PageTrafficReport report_;
  std::vector<std::thread> loaders_;
};

}  // namespace trex
