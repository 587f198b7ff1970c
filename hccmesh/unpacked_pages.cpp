#include "hccmesh/unpacked_pages.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace hccm {

void Saving::took(double seconds, double instead) {
  const double before = std::max(seconds_.load(), 1e-9);
  const bool tries = before >= instead;
  // A trial says more than what was long ago; after one that paid comes another.
  const double weight = tries ? 0.5 : 0.1;
  seconds_.store(before + weight * (std::min(seconds, 4.0 * before) - before));
  if (!tries || seconds >= instead) without_.store(0.0);
}

UnpackedPages::UnpackedPages(int file, std::uint64_t limit, std::size_t pages, bool measures,
                             ThreadMoment (*clock)())
    : file_(file), limit_(limit), measures_(measures), clock_(clock), entries_(pages) {}

UnpackedPages::~UnpackedPages() { ::close(file_); }

bool UnpackedPages::read(std::uint32_t page, std::span<std::byte> out) {
  const bool measures = measuresRead();
  const ThreadMoment start = measures ? clock_() : ThreadMoment();
  Entry& entry = entries_[page];
  std::uint64_t offset = entry.offset.load(std::memory_order_acquire);
  for (std::span<std::byte> left = out; !left.empty();) {
    const ssize_t got = ::pread(file_, left.data(), left.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) break;
    left = left.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
    if (!left.empty()) continue;
    if (XXH3_64bits(out.data(), out.size()) != entry.checksum) break;
    if (!measures) return true;
    const double seconds = secondsTaken(start, clock_());
    wasSlow_ = seconds > kSlow * reading_.value();
    reading_.took(seconds, unpacking_.value());
    return true;
  }
  entry.offset.store(kNowhere);
  return false;
}

bool UnpackedPages::write(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t done = ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(done));
    offset += static_cast<std::uint64_t>(done);
  }
  return true;
}

void UnpackedPages::keep(std::uint32_t page, std::span<const std::byte> bytes,
                         double unpackSeconds) {
  unpacking_.took(unpackSeconds, HUGE_VAL);
  if (isThere(page)) return reading_.without(unpackSeconds);
  if (full_) return;
  if (measures_ && !writing_.pays(unpacking_.value())) return writing_.without(unpackSeconds);
  const ThreadMoment start = clock_();
  const std::uint64_t offset = end_.fetch_add(bytes.size());
  if (offset + bytes.size() > limit_ || !write(offset, bytes)) {
    end_.fetch_sub(bytes.size());
    full_ = true;
    return;
  }
  Entry& entry = entries_[page];
  entry.checksum = XXH3_64bits(bytes.data(), bytes.size());
  entry.offset.store(offset, std::memory_order_release);
  writing_.took(secondsTaken(start, clock_()), unpacking_.value());
}

}  // namespace hccm
