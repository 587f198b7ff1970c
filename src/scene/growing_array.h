// Arrays of vertices and triangles that are read before their number is known: they grow without
// being copied, in memory, or in a file without a name, for models that are larger than memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <new>
#include <type_traits>
#include <utility>

namespace trex::detail {

/// Where such an array lies: mapped memory of its own. Not copied; const calls are thread safe.
class GrowingMemory {
 public:
  /// With a folder, in a file there that goes with this object; else in memory.
  explicit GrowingMemory(std::filesystem::path folder = {}) : folder_(std::move(folder)) {}
  ~GrowingMemory();
  GrowingMemory(GrowingMemory&& other) noexcept { *this = std::move(other); }
  GrowingMemory& operator=(GrowingMemory&& other) noexcept;

  std::byte* data() const { return data_; }
  std::size_t capacity() const { return capacity_; }
  bool inFile() const { return !folder_.empty(); }
  /// Makes room for so many bytes. Throws std::bad_alloc, of a file Error(kOutput) if the disk is
  /// full or can't be written.
  void reserve(std::size_t bytes);
  /// Takes what was used so far out of this process, if it lies in a file: it comes back when it is
  /// used again.
  void forget() const;

 private:
  void openFile();

  std::filesystem::path folder_;
  int file_ = -1;
  std::byte* data_ = nullptr;
  std::size_t capacity_ = 0;
};

/// Of values that can be moved as bytes.
template <typename T>
class GrowingArray {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  explicit GrowingArray(std::filesystem::path folder = {}) : memory_(std::move(folder)) {}

  void push_back(const T& value) {
    if ((size_ + 1) * sizeof(T) > memory_.capacity()) memory_.reserve((size_ + 1) * sizeof(T));
    new (start() + size_++) T(value);
    if (size_ % kForget == 0) memory_.forget();
  }
  /// Appends `count` values.
  void append(const T* values, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) push_back(values[i]);
  }
  /// Appends values until there are so many.
  void fill(std::size_t size, const T& value) {
    while (size_ < size) push_back(value);
  }
  T& operator[](std::size_t i) { return start()[i]; }
  const T& operator[](std::size_t i) const { return start()[i]; }
  const T* data() const { return start(); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  /// Bytes of memory that the array takes for good.
  std::size_t residentBytes() const { return memory_.inFile() ? 0 : memory_.capacity(); }
  void forget() const { memory_.forget(); }

 private:
  static constexpr std::size_t kForget = (std::size_t{8} << 20) / sizeof(T);
  T* start() const { return reinterpret_cast<T*>(memory_.data()); }

  GrowingMemory memory_;
  std::size_t size_ = 0;
};

}  // namespace trex::detail
