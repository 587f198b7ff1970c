// Pages of a mesh in memory, under a hard limit, and rays against them.
//
// A page in use is pinned: it stays where it is until its last pin is gone. A page that is not
// there is loaded by the thread that wants it, after unpinned ones were evicted that were not used
// for longest (second chance, a clock's hand over all pages). If everything else is pinned the
// thread waits; so a thread must hold no pin while it asks for another page. Pages behind a
// missing one are read ahead by the operating system meanwhile.
//
// A page that can't be read or is damaged throws at each pin(); it is never traced.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "hccmesh/page_fetcher.h"
#include "hccmesh/pages.h"
#include "hccmesh/unpacked_pages.h"

namespace hccm {

/// Thread safe.
class PageCache {
 public:
  struct Statistics {
    std::uint64_t loads = 0, evictions = 0, bytesRead = 0;
    std::uint64_t restored = 0;              ///< of the loads, those that unpacked nothing
    std::uint64_t keptBytes = 0;             ///< of the file of unpacked pages
    std::uint64_t bytes = 0, peakBytes = 0;  ///< in memory, of all pages
  };

  /// Keeps one page alive. Movable; belongs to one thread.
  class Pin {
   public:
    Pin() = default;
    Pin(Pin&& other) noexcept
        : cache_(std::exchange(other.cache_, nullptr)), page_(other.page_), mesh_(other.mesh_) {}
    Pin& operator=(Pin&& other) noexcept {
      if (this == &other) return *this;
      release();
      cache_ = std::exchange(other.cache_, nullptr);
      page_ = other.page_;
      mesh_ = other.mesh_;
      return *this;
    }
    ~Pin() { release(); }
    bool holds(std::uint32_t page) const { return cache_ != nullptr && page_ == page; }
    const Mesh& mesh() const { return *mesh_; }
    void release();

   private:
    friend class PageCache;
    PageCache* cache_ = nullptr;
    std::uint32_t page_ = 0;
    const Mesh* mesh_ = nullptr;
  };

  /// `limit`: bytes of pages in memory, at least leastBytes(). File and table must outlive it.
  /// Throws std::invalid_argument for a limit that is too small.
  /// A page with a material of `materials` or beyond counts as damaged. `kept`: where pages go that
  /// were unpacked; null: nowhere.
  PageCache(const PageFile& file, const PageTable& table, std::uint64_t limit,
            std::uint32_t materials = 0xffffffffu, std::unique_ptr<UnpackedPages> kept = {});
  ~PageCache();
  PageCache(const PageCache&) = delete;
  PageCache& operator=(const PageCache&) = delete;

  /// The largest page.
  static std::uint64_t leastBytes(const PageTable& table);
  /// Bytes that a page counts with.
  static std::uint64_t bytesOf(const PageEntry& entry);

  /// Pins a page, loading it if need be. Throws what loadPage() throws.
  Pin pin(std::uint32_t page);
  /// Of a page whose packed bytes were read already (readPage()).
  Pin pin(std::uint32_t page, std::span<const std::byte> packed);
  /// Pins a page if it is there, at once; else the pin holds nothing.
  Pin pinIfHere(std::uint32_t page);
  /// Whether a page is there. By the time of the answer another thread may have changed that.
  bool isHere(std::uint32_t page) const { return slots_[page].state.load() >= 0; }
  /// Gives up a page, for callers who know better than the clock's hand. False if it is pinned or
  /// not there.
  bool evict(std::uint32_t page);
  Statistics statistics() const;
  std::uint64_t limit() const { return limit_; }
  /// Whether all pages have room.
  bool holdsAll() const;
  /// Where the pages lie.
  const PageFile& file() const { return file_; }
  /// Whether pin() takes a page from those that were unpacked before, and needs no packed bytes.
  bool isKept(std::uint32_t page) const { return kept_ && kept_->has(page); }
  /// That this takes.
  double keptSeconds() const { return kept_ ? kept_->readSeconds() : 0.0; }
  /// Seconds that the calling thread has waited in pin(), of any cache, since it began: for what is
  /// read, for threads that load the same page, and for room. Unpacking is work.
  static double secondsWaited();

 private:
  // state: number of pins, or one of these. A page that is kLoading or kEvicting belongs to one
  // thread.
  static constexpr std::int32_t kAbsent = -1, kBusy = -2;
  struct Slot {
    std::atomic<std::int32_t> state{kAbsent};
    std::atomic<std::uint8_t> used{0};  ///< since the hand passed
    bool known = false;                 ///< it was whole when it came
    std::uint32_t place = 0;            ///< in present_, while it is there
    std::unique_ptr<Mesh> mesh;
  };

  bool tryPin(Slot& slot);
  Pin pinned(std::uint32_t page);
  bool giveUp(std::size_t place);
  void unpin(std::uint32_t page);
  Pin load(std::uint32_t page, std::span<const std::byte> packed);
  std::unique_ptr<Mesh> restore(std::uint32_t page);
  std::unique_ptr<Mesh> unpack(std::uint32_t page, std::span<const std::byte> packed);
  double secondsToSend(std::uint32_t page) const;
  void readAhead(std::uint32_t page) const;
  void wait(std::unique_lock<std::mutex>& lock);
  bool evictOne();
  void reserve(std::uint64_t bytes, std::unique_lock<std::mutex>& lock);

  const PageFile& file_;
  const PageTable& table_;
  const std::uint64_t limit_;
  const std::uint32_t materials_;
  const std::unique_ptr<UnpackedPages> kept_;
  Mesh grid_;
  std::vector<Slot> slots_;
  mutable std::mutex mutex_;  ///< of everything below
  std::condition_variable changed_;
  std::atomic<std::uint32_t> waiting_{0};  ///< threads that wait for an unpin
  std::vector<std::uint32_t> present_;     ///< pages in memory
  std::size_t hand_ = 0;                   ///< into present_
  Statistics statistics_;
};

/// A mesh of pages, as rays see it. All const calls are thread safe.
class PagedMesh {
 public:
  using Pin = PageCache::Pin;

  /// `cacheBytes`: limit of pages in memory. Throws std::invalid_argument if it is less than a
  /// page. `materials`: those of clusters are below. `kept`: as PageCache's.
  PagedMesh(PageTable table, std::unique_ptr<PageFile> file, std::uint64_t cacheBytes,
            std::uint32_t materials = 0xffffffffu, std::unique_ptr<UnpackedPages> kept = {});

  const PageTable& table() const { return table_; }
  PageCache::Statistics statistics() const { return cache_.statistics(); }
  std::uint64_t cacheBytes() const { return cache_.limit(); }
  double step() const { return grid_.step(); }
  double errorBound() const;
  std::uint32_t groupCount() const { return static_cast<std::uint32_t>(table_.groups.size()); }
  PreparedRay prepare(const Ray& ray) const { return grid_.prepare(ray); }

  /// As Mesh::intersect() for all clusters of a group. `pin` is the caller's, kept from call to
  /// call. Throws what loadPage() throws.
  bool intersect(std::uint32_t group, PreparedRay& ray, Hit& hit, Pin& pin) const;
  bool occluded(std::uint32_t group, PreparedRay& ray, Pin& pin) const;
  /// Decodes a triangle of a hit. Throws what loadPage() throws. Where rays do not wait and its
  /// page has gone it is some triangle, and that page was missed.
  Triangle triangle(std::uint32_t cluster, std::uint32_t index) const;
  /// Where a ray enters a group's box, a little early: t of the direction that it was given with.
  float entry(std::uint32_t group, const PreparedRay& ray) const;
  /// From now on pages come behind rays that do not wait (page_fetcher.h). To be called once,
  /// before the first ray.
  void fetchBehind() { fetcher_ = std::make_unique<PageFetcher>(cache_, table_); }
  /// Null unless they do.
  PageFetcher* fetcher() const { return fetcher_.get(); }
  /// Whether rays, and triangle(), wait for pages that are not there, as they do unless told
  /// otherwise; without a fetcher they do in any case. Of all threads.
  void setWaiting(bool waits) const { waits_.store(waits, std::memory_order_relaxed); }
  /// Pins the page of a group. False if it is not there and rays do not wait: the fetcher knows.
  /// Throws what loadPage() throws.
  bool comes(std::uint32_t group, Pin& pin) const;
  /// Whether the page of a group is there, without loading it; then `pin` holds it.
  bool reachIfHere(std::uint32_t group, Pin& pin) const;
  /// Pins a page, to walk over its triangles.
  Pin page(std::uint32_t number) const { return cache_.pin(number); }
  /// For who decides what is loaded and given up. Thread safe.
  PageCache& cache() const { return cache_; }

 private:
  void reach(std::uint32_t page, Pin& pin) const;

  PageTable table_;
  std::unique_ptr<PageFile> file_;
  Mesh grid_;
  mutable PageCache cache_;
  mutable std::atomic<bool> waits_{true};
  std::unique_ptr<PageFetcher> fetcher_;  ///< the last: it calls the others
};

}  // namespace hccm
