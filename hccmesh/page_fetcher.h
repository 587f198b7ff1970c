// Pages that come while nobody waits for them, of a file that is far away: rays tell which they
// have missed, threads of this bring them, in that order, and in between pages that nobody has
// asked for yet, if all of them have room.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace hccm {

class PageCache;
struct PageTable;

/// Thread safe.
class PageFetcher {
 public:
  /// The cache, its file and the table must outlive it.
  PageFetcher(PageCache& cache, const PageTable& table);
  /// Waits for what is being read.
  ~PageFetcher();
  PageFetcher(const PageFetcher&) = delete;
  PageFetcher& operator=(const PageFetcher&) = delete;

  /// A ray of the calling thread met a page that is not there: it will be. Returns at once.
  void miss(std::uint32_t page);
  /// Such rays: of all threads, and of the calling thread since it began, of any mesh.
  std::uint64_t misses() const { return misses_.load(); }
  static std::uint64_t missesHere();

  /// Pages that were asked for, and how many of them have come since. Throws what reading one
  /// threw: then no more will come.
  std::uint64_t asked() const { return asked_.load(); }
  std::uint64_t brought() const;
  /// Waits until so many of those that were asked for have come, or for some seconds. Throws as
  /// brought().
  void await(std::uint64_t count, double seconds) const;

 private:
  void work(bool ahead);
  std::vector<std::uint32_t> next(bool ahead);
  void bring(const std::vector<std::uint32_t>& pages);
  std::vector<std::uint32_t> pagesAhead();

  PageCache& cache_;
  const PageTable& table_;
  std::vector<std::atomic<std::uint8_t>> wanted_;  ///< by page: it was asked for and is not there
  std::atomic<std::uint64_t> misses_{0}, asked_{0};
  mutable std::mutex mutex_;  ///< of everything below
  mutable std::condition_variable wake_, came_;
  std::deque<std::uint32_t> queue_;
  std::uint64_t brought_ = 0;
  std::uint32_t ahead_ = 0;  ///< the next page that nobody asked for
  bool ends_ = false;
  std::exception_ptr problem_;
  std::vector<std::thread> threads_;
};

}  // namespace hccm
