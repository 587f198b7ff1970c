#include "src/bench/cold_pages.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "src/core/clock.h"

namespace trex {
namespace {

constexpr std::uint64_t kBlock = 4096;  // that O_DIRECT wants places, sizes and memory aligned to

/// Memory of a thread for whole blocks.
std::byte* blocks(std::uint64_t bytes) {
  struct Free {
    void operator()(std::byte* p) const { std::free(p); }
  };
  thread_local std::unique_ptr<std::byte, Free> memory;
  thread_local std::uint64_t size = 0;
  if (size < bytes) {
    memory.reset(static_cast<std::byte*>(std::aligned_alloc(kBlock, bytes)));
    size = memory ? bytes : 0;
    if (!memory) throw std::bad_alloc();
  }
  return memory.get();
}

}  // namespace

void SlowDisk::serve(std::size_t bytes) {
  if (bandwidth_ <= 0.0) return;
  double end = 0.0;
  {
    const std::lock_guard lock(mutex_);
    free_ = end =
        std::max(free_, secondsNow()) + latency_ + static_cast<double>(bytes) / bandwidth_;
  }
  std::this_thread::sleep_for(std::chrono::duration<double>(end - secondsNow()));
}

ColdPages::ColdPages(const std::filesystem::path& path, std::uint64_t start,
                     std::shared_ptr<SlowDisk> disk)
    : warm_(path, start),
      start_(start),
      disk_(std::move(disk)),
      file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECT)) {}

ColdPages::~ColdPages() {
  if (file_ >= 0) ::close(file_);
}

void ColdPages::read(std::uint64_t offset, std::span<std::byte> out) const {
  const std::uint64_t from = (start_ + offset) / kBlock * kBlock, skipped = start_ + offset - from;
  const std::uint64_t bytes = (skipped + out.size() + kBlock - 1) / kBlock * kBlock;
  std::byte* const memory = blocks(bytes);
  const ssize_t got =
      isCold() ? ::pread(file_, memory, bytes, static_cast<off_t>(from)) : ssize_t{-1};
  if (got >= 0 && static_cast<std::uint64_t>(got) >= skipped + out.size()) {
    std::memcpy(out.data(), memory + skipped, out.size());
  } else {
    warm_.read(offset, out);  // which says what is wrong, if it is
  }
  if (disk_) disk_->serve(out.size());
}

}  // namespace trex
