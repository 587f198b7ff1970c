// What the readers of STL share.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "src/scene/import.h"

namespace trex::detail {

/// Bytes of a binary file: 80 of text and the count (u32), then for each triangle its normal and
/// three corners (3 f32 each, little endian) and 2 of attributes. Some programs keep colours in
/// these, in ways that differ; they are not shown.
inline constexpr std::size_t kStlHeader = 84, kStlTriangle = 50;

struct StlKind {
  bool binary = false;
  std::uint64_t said = 0;       ///< triangles, by the header
  std::uint64_t triangles = 0;  ///< of those that the file has room for; all if it says 0
};

/// Looks at the first bytes and the size. Throws Error(kInput) if the file can't be read.
StlKind kindOfStl(const std::filesystem::path& path);

template <typename Byte>
bool hasAttributes(const Byte* facet) {
  return facet[kStlTriangle - 2] != Byte{0} || facet[kStlTriangle - 1] != Byte{0};
}

/// Warns of facets with attributes, if there are any.
void tellAttributes(Scene& scene, const std::string& file, std::uint64_t facets);

}  // namespace trex::detail
