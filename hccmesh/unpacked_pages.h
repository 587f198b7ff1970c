// Pages as they lie in memory, kept in a file beside the cache: what was unpacked once is read
// again, which takes a processor a tenth of the time of unpacking and asks nobody else for the
// packed bytes.
//
// Nothing depends on it: a page that the file has no room for, that can't be written or comes back
// otherwise is unpacked again. So it is where keeping takes longer than unpacking, as both were
// measured lately (thread_clock.h): then few pages are tried.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hccmesh/thread_clock.h"

namespace hccm {

/// Whether something that is to save time does: what it takes, as a mean of the last times that one
/// which took very long hardly moves, against what it takes without it. Where it does not pay it is
/// tried again for a share of the time that is spent without it, so that a disk that was busy is
/// found free soon. Thread safe.
class Saving {
 public:
  explicit Saving(double first) : seconds_(first) {}
  /// `instead`: seconds that it saves.
  bool pays(double instead) const {
    return value() < instead || without_.load(std::memory_order_relaxed) > kBetweenTrials * value();
  }
  /// It was done.
  void took(double seconds, double instead);
  /// It was not, and this is what had to be done.
  void without(double seconds) { without_.store(without_.load() + seconds); }
  /// Seconds that it usually takes.
  double value() const { return seconds_.load(std::memory_order_relaxed); }

 private:
  static constexpr double kBetweenTrials = 20.0;  ///< of what a trial is expected to take
  std::atomic<double> seconds_, without_{0.0};
};

/// Thread safe, but one thread at a time for a page.
class UnpackedPages {
 public:
  /// `file`: a descriptor that is open for reading and writing and is closed with this; who has no
  /// name for it leaves nothing behind. `limit`: its bytes at most. `measures`: keeps pages, and
  /// gives them, only where that takes less than unpacking.
  /// `clock`: of the calling thread.
  UnpackedPages(int file, std::uint64_t limit, std::size_t pages, bool measures = true,
                ThreadMoment (*clock)() = threadMoment);
  ~UnpackedPages();
  UnpackedPages(const UnpackedPages&) = delete;
  UnpackedPages& operator=(const UnpackedPages&) = delete;

  /// Memory of so many pages' entries, bytes.
  static std::uint64_t bytesFor(std::size_t pages) { return pages * sizeof(Entry); }

  /// Whether read() is to be asked for a page rather than unpacking it.
  bool has(std::uint32_t page) const {
    return isThere(page) && (!measures_ || reading_.pays(unpacking_.value()));
  }
  /// The bytes that write() was given. False, and the page is forgotten, if they are not as they
  /// were.
  bool read(std::uint32_t page, std::span<std::byte> out);
  /// A page was unpacked: keeps it, if that is worth while. `unpackSeconds`: that it took to have
  /// it, from the file where the packed ones are.
  void keep(std::uint32_t page, std::span<const std::byte> bytes, double unpackSeconds);

  double readSeconds() const { return reading_.value(); }
  /// Of the file.
  std::uint64_t bytes() const { return end_.load(); }

 private:
  static constexpr std::uint64_t kNowhere = ~std::uint64_t{0};
  static constexpr double kFar = 0.25, kSlow = 4.0;
  static constexpr std::uint32_t kMeasured = 4;
  struct Entry {
    std::atomic<std::uint64_t> offset{kNowhere};
    std::uint64_t checksum = 0;
  };
  bool isThere(std::uint32_t page) const {
    return entries_[page].offset.load(std::memory_order_acquire) != kNowhere;
  }
  bool write(std::uint64_t offset, std::span<const std::byte> bytes);
  /// Whether the next read is measured: where reads take far less than unpacking one of some will
  /// do, as a look at a thread's clock costs a tenth of such a read; all after one that was slow.
  bool measuresRead() {
    const bool near = wasSlow_ || reading_.value() > kFar * unpacking_.value();
    return near || reads_.fetch_add(1, std::memory_order_relaxed) % kMeasured == 0;
  }

  const int file_;
  const std::uint64_t limit_;
  const bool measures_;
  ThreadMoment (*const clock_)();
  std::vector<Entry> entries_;
  std::atomic<std::uint64_t> end_{0};
  std::atomic<std::uint32_t> reads_{0};
  std::atomic<bool> wasSlow_{false};  ///< the last read that was measured
  std::atomic<bool> full_{false};     ///< or broken: nothing is written any more
  Saving reading_{1e-5}, writing_{1e-5}, unpacking_{1e-4};
};

}  // namespace hccm
