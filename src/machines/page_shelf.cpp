#include "src/machines/page_shelf.h"

#include <unistd.h>

#include <cerrno>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace trex::machines {
namespace {

/// All of it, by pread or pwrite.
template <class F>
bool whole(F&& call, std::size_t bytes, std::uint64_t at) {
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t got = call(done, bytes - done, static_cast<off_t>(at + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    done += static_cast<std::size_t>(got);
  }
  return true;
}

}  // namespace

PageShelf::~PageShelf() { ::close(file_); }

bool PageShelf::read(std::uint64_t offset, std::span<std::byte> out) {
  Entry entry;
  {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(offset);
    if (found == entries_.end() || found->second.bytes != out.size()) return false;
    entry = found->second;
  }
  const auto get = [&](std::size_t done, std::size_t bytes, off_t at) {
    return ::pread(file_, out.data() + done, bytes, at);
  };
  if (whole(get, out.size(), entry.at) && XXH3_64bits(out.data(), out.size()) == entry.checksum) {
    return true;
  }
  const std::lock_guard lock(mutex_);
  entries_.erase(offset);
  return false;
}

void PageShelf::keep(std::uint64_t offset, std::span<const std::byte> bytes) {
  Entry entry{0, XXH3_64bits(bytes.data(), bytes.size()), bytes.size()};
  {
    const std::lock_guard lock(mutex_);
    if (full_ || entries_.contains(offset)) return;
    if (bytes.size() > limit_ - end_) {
      full_ = true;
      return;
    }
    entry.at = end_;
    end_ += bytes.size();
  }
  const auto put = [&](std::size_t done, std::size_t count, off_t at) {
    return ::pwrite(file_, bytes.data() + done, count, at);
  };
  const bool written = whole(put, bytes.size(), entry.at);
  const std::lock_guard lock(mutex_);
  if (written) {
    entries_.emplace(offset, entry);
  } else {
    full_ = true;
  }
}

}  // namespace trex::machines
