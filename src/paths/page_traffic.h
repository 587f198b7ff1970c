// Between rays that wait and pages that come: threads that read, and what is ready to be traced.
//
//   rays ─► PageQueues ─► LoadChoice: which page next ─► reading threads ─► packed pages
//                │                                                               │ unpacked by a
//                │                                                               ▼ thread without
//                rays └──────── work: rays of a page that is there ◄───────────── PageCache
//
// Where the disk is slow pages are read while rays are traced, so that no thread waits for it as
// long as it has rays to trace or a page to unpack: those that rays wait for, and, where the disk
// has nothing else to do, those where rays are expected. Else a thread without rays reads a page by
// itself. Unpacking takes a processor and room in the cache, so nothing is unpacked before a ray
// waits for it. A page stays as long as rays wait for it or are traced
// against it (but a stage that loads on demand may drive it out: then its rays wait again). One
// that the cache has kept since it was unpacked (PageCache::isKept()) takes hardly longer than a
// look into memory, so a thread that traces gets it by itself.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/paths/load_choice.h"
#include "src/paths/page_queues.h"

namespace trex {

/// What it did so far. Seconds of threads, added up.
struct PageTrafficReport {
  double tracing = 0.0;  ///< threads that trace, and all that they do
  /// Of these, without a ray to trace or a page to unpack: for the disk, here or in a stage that
  /// loads on demand, or for others that trace the last rays.
  double waiting = 0.0;
  double unpacking = 0.0;       ///< of these, too
  double reading = 0.0;         ///< threads that read
  std::uint64_t loads = 0;      ///< pages that were unpacked, or taken as they had been
  std::uint64_t readAhead = 0;  ///< of these, read before a ray waited for them
  std::uint64_t readInVain = 0;
  std::uint64_t planned = 0;          ///< packed bytes of pages that were chosen and unpacked
  std::uint64_t rays = 0, waits = 0;  ///< rays that have waited, and for how many pages in all
  void add(const PageTrafficReport& o) {
    tracing += o.tracing, waiting += o.waiting, unpacking += o.unpacking, reading += o.reading;
    loads += o.loads, readAhead += o.readAhead, readInVain += o.readInVain;
    planned += o.planned, rays += o.rays, waits += o.waits;
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
  double waited = 0.0;                 ///< of that, for pages that stages loaded on demand
  std::uint64_t ended = 0;             ///< paths
  std::vector<std::uint32_t> waits{};  ///< pages that rays wait for now, one each
  std::uint64_t rays = 0;              ///< of these, that had not waited before
};

/// For one set of paths. Threads that trace call next() and done(); its own ones read.
class PageTraffic {
 public:
  /// `paths` are numbers [0, paths) that are to begin, as there is room for them.
  /// `readers`: threads of its own. `record` may be null.
  PageTraffic(const hccm::PagedMesh& mesh, LoadChoice& choice, PageQueues& queues,
              std::uint64_t paths, unsigned readers, TrafficRecord* record);
  /// Ends the reading threads.
  ~PageTraffic();
  PageTraffic(const PageTraffic&) = delete;
  PageTraffic& operator=(const PageTraffic&) = delete;

  /// Work for a thread that traces; unpacks pages if there is none, and waits for one if there is
  /// none of these either. False when all paths have ended, or a page can't be loaded, or after
  /// giveUp().
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
  /// Packed pages in memory, as a share of the cache; at least as many as threads read.
  static constexpr std::uint64_t kPackedShare = 16;
  /// Reads that are begun before their pages are needed, as a multiple of how many pages are
  /// unpacked meanwhile.
  static constexpr double kAhead = 8.0;
  static constexpr std::size_t kMostKept =
      16;  ///< kept pages that are chosen before a thread is free

  /// A page that was read, or is being read.
  struct Packed {
    std::uint32_t page;
    bool ahead;  ///< no ray had waited for it
    std::vector<std::byte> bytes;
    bool kept = false;  ///< it was unpacked before, and nothing was read
  };

  struct Span {
    double start, end;  ///< secondsNow()
  };

  bool takeReady(PageWork& work);
  void announce(std::uint32_t page);
  bool announceHere();
  void wakeReader();
  void announceLocked(std::uint32_t page);
  void failLocked(std::exception_ptr error);
  bool takeKept();
  void want();
  bool unpackOne(std::unique_lock<std::mutex>& lock, unsigned thread);
  bool makeRoom(std::uint64_t bytes);

  void read(unsigned reader);
  std::optional<Packed> toRead(bool mayBeAhead);
  std::size_t depth() const;
  bool readHere(std::unique_lock<std::mutex>& lock, unsigned thread);
  void takeToRead(std::vector<Packed>& some);
  Span readThese(std::unique_lock<std::mutex>& lock, std::span<Packed> some);
  bool fits(std::uint64_t bytes);
  void drop(std::size_t place);

  const hccm::PagedMesh& mesh_;
  hccm::PageCache& cache_;
  LoadChoice& choice_;
  PageQueues& queues_;
  TrafficRecord* record_;
  std::vector<std::atomic<std::uint8_t>> announced_;  ///< by page: it is in ready_
  std::mutex mutex_;                                  ///< of all below
  std::condition_variable work_, disk_;
  std::deque<PageWork> ready_;  ///< of pages alone: their queues are to be taken
  std::uint64_t next_ = 0, paths_, left_;
  std::vector<Packed> packed_;                 ///< that were read
  std::vector<std::vector<std::byte>> spare_;  ///< memory of such that were unpacked
  std::uint64_t packedBytes_ = 0;  ///< of these, and of those that are being read or unpacked
  const unsigned atOnce_;          ///< pages that a thread reads at once
  std::uint64_t packedLimit_, largest_ = 0;  ///< largest_: packed page
  std::size_t kept_ = 0;                     ///< of packed_, that need not be read
  std::optional<std::uint32_t> wanted_;      ///< the next to read, once there is room
  std::size_t reading_ = 0;                  ///< pages that are being read
  double unpacked_ = 0.0, interval_ = 1e-3;  ///< when a page was, and seconds from one to the next
  std::uint64_t unpackingBytes_ = 0;         ///< in the cache
  int idle_ = 0;                             ///< threads that trace and have nothing to do
  std::uint64_t loadsOfStages_ = 0;          ///< of the cache, when announceHere() last looked
  double lookedHere_ = 0.0;                  ///< when that was
  bool stop_ = false;
  std::exception_ptr failed_;
  PageTrafficReport report_;
  std::vector<std::thread> readers_;
};

}  // namespace trex
