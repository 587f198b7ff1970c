// What the process and the machine have of memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace trex {

/// Largest resident size of this process so far, bytes (getrusage).
std::uint64_t peakResidentBytes();

/// Resident size of this process at the moment, bytes; 0 if unknown.
std::uint64_t residentBytes();

/// Memory this process may use: the smaller of physical memory and the cgroup's limit, bytes.
std::uint64_t availableMemoryLimit();

/// Asks for large pages where a block, which nobody has touched yet, holds some: its first use then
/// takes less time. A hint.
void wantLargePages(void* at, std::size_t bytes);

/// Memory that is taken in one piece and used whole, such as that of pictures.
template <typename T>
struct LargePages : std::allocator<T> {
  template <typename U>
  struct rebind {
    using other = LargePages<U>;
  };
  T* allocate(std::size_t count) {
    T* at = std::allocator<T>::allocate(count);
    wantLargePages(at, count * sizeof(T));
    return at;
  }
};
template <typename T>
using LargeVector = std::vector<T, LargePages<T>>;

/// "1.5 MiB" for people.
std::string formatBytes(std::uint64_t bytes);

}  // namespace trex
