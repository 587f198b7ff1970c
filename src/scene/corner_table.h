// Vertices of meshes whose corners have several numbers: position, texture coordinate, normal...
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace trex::detail {

/// Numbers the distinct corners of a mesh in order of appearance. Open addressing: 4 bytes a slot.
template <std::size_t kNumbers>
class CornerTable {
 public:
  using Corner = std::array<std::int32_t, kNumbers>;

  std::uint32_t indexOf(const Corner& corner) {
    if (corners_.size() * 2 >= slots_.size()) grow();
    std::uint32_t& slot = slots_[find(corner)];
    if (slot == 0) {
      corners_.push_back(corner);
      slot = static_cast<std::uint32_t>(corners_.size());
    }
    return slot - 1;
  }
  const std::vector<Corner>& corners() const { return corners_; }
  std::size_t residentBytes() const {
    return slots_.capacity() * sizeof(slots_[0]) + corners_.capacity() * sizeof(Corner);
  }

 private:
  static std::size_t hash(const Corner& corner) {
    std::uint64_t h = 0;
    for (const std::int32_t number : corner) {
      h = (h ^ (h >> 29) ^ static_cast<std::uint32_t>(number)) * 0x9e3779b97f4a7c15ull;
    }
    return static_cast<std::size_t>(h ^ (h >> 31));
  }
  std::size_t find(const Corner& corner) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = hash(corner) & mask;
    while (slots_[at] != 0 && corners_[slots_[at] - 1] != corner) at = (at + 1) & mask;
    return at;
  }
  void grow() {
    slots_.assign(std::max<std::size_t>(64, slots_.size() * 2), 0);
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      slots_[find(corners_[i])] = static_cast<std::uint32_t>(i + 1);
    }
  }

  std::vector<std::uint32_t> slots_;  ///< 1 + index into corners_; 0 is free
  std::vector<Corner> corners_;
};

}  // namespace trex::detail
