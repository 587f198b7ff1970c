// Memory of a mesh: zeroed, in huge pages where there are any. Rays jump about in it, and a page
// that the processor does not know costs as much as the data.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

namespace hccm {

class Bytes {
 public:
  Bytes() = default;
  /// Throws std::bad_alloc.
  explicit Bytes(std::size_t size);
  std::byte* data() { return data_.get(); }
  const std::byte* data() const { return data_.get(); }
  std::size_t size() const { return size_; }
  operator std::span<std::byte>() { return {data(), size()}; }
  operator std::span<const std::byte>() const { return {data(), size()}; }

 private:
  struct Free {
    void operator()(std::byte* at) const;
  };
  std::unique_ptr<std::byte, Free> data_;
  std::size_t size_ = 0;
};

}  // namespace hccm
