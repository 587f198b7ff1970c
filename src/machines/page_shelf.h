// Packed pages that came from machine 0, in a file, for other machines that ask for them.
#pragma once

#include <cstdint>
#include <mutex>
#include <span>
#include <unordered_map>

namespace trex::machines {

/// Nothing depends on it: what it has no room for, can't write or finds changed is asked for again.
/// Thread safe.
class PageShelf {
 public:
  /// `file`: a descriptor that is open for reading and writing and is closed with this; who has no
  /// name for it leaves nothing behind. `limit`: its bytes at most.
  PageShelf(int file, std::uint64_t limit) : file_(file), limit_(limit) {}
  ~PageShelf();
  PageShelf(const PageShelf&) = delete;
  PageShelf& operator=(const PageShelf&) = delete;

  /// What was kept of an offset, if it has the size of `out` and is as it was.
  bool read(std::uint64_t offset, std::span<std::byte> out);
  void keep(std::uint64_t offset, std::span<const std::byte> bytes);

 private:
  struct Entry {
    std::uint64_t at = 0, checksum = 0;  ///< at: in the file
    std::size_t bytes = 0;
  };
  const int file_;
  const std::uint64_t limit_;
  std::mutex mutex_;  ///< of all below
  std::unordered_map<std::uint64_t, Entry> entries_;
  std::uint64_t end_ = 0;
  bool full_ = false;  ///< or broken: nothing is written any more
};

}  // namespace trex::machines
