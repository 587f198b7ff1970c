// The triangles of a leaf as one generalised strip, which is what its topology is stored as.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "hccmesh/layout.h"

namespace hccm {

using Corners = std::array<std::uint16_t, 3>;  ///< vertex numbers, counter-clockwise from the front

/// Entries e[0..size); bit p of `starts` makes e[p], e[p+1], e[p+2] a triangle (e[p+1], e[p],
/// e[p+2] for odd p). Triangles count in the order of their starts.
struct Strip {
  std::array<std::uint16_t, layout::kMaxEntries> entries;
  std::uint32_t size = 0;
  std::uint32_t starts = 0;
};

/// A short strip of up to 8 triangles, greedily from several starts. A triangle keeps its winding
/// and may begin at another of its corners. False if it takes more than layout::kMaxEntries. Thread
/// safe.
bool makeStrip(std::span<const Corners> triangles, Strip& out);

}  // namespace hccm
