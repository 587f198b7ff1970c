#include "hccmesh/unpacked_pages.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace hccm {
namespace {

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

void UsualSeconds::took(double seconds) {
  const double before = seconds_.load();
  seconds_.store(before + 0.1 * (std::min(seconds, 4.0 * before) - before));
}

UnpackedPages::UnpackedPages(int file, std::uint64_t limit, std::size_t pages, bool measures)
    : file_(file), limit_(limit), measures_(measures), entries_(pages) {}

UnpackedPages::~UnpackedPages() { ::close(file_); }

bool UnpackedPages::read(std::uint32_t page, std::span<std::byte> out) {
  const auto start = std::chrono::steady_clock::now();
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
    reading_.took(secondsSince(start));
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
  unpacking_.took(unpackSeconds);
  if (isThere(page)) return reading_.missed();
  if (full_) return;
  if (!pays(writing_)) return writing_.missed();
  const auto start = std::chrono::steady_clock::now();
  const std::uint64_t offset = end_.fetch_add(bytes.size());
  if (offset + bytes.size() > limit_ || !write(offset, bytes)) {
    end_.fetch_sub(bytes.size());
    full_ = true;
    return;
  }
  Entry& entry = entries_[page];
  entry.checksum = XXH3_64bits(bytes.data(), bytes.size());
  entry.offset.store(offset, std::memory_order_release);
  writing_.took(secondsSince(start));
}

}  // namespace hccm
