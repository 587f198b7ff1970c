// The quantised box of a leaf.
#pragma once

#include <algorithm>
#include <cstdint>

#include "hccmesh/leaf.h"

namespace hccm {

/// The tightest planes around a leaf's vertices: lower x, upper x, lower y, ... `offset` is by
/// vertex of the cluster, in cells from the cluster's lower corner, not negative.
inline void leafBox(const LeafTopology& leaf, const std::int32_t (*offset)[3],
                    const std::uint8_t* shift, std::uint8_t* planes) {
  for (int k = 0; k < 3; ++k) {
    std::uint32_t lower = 0xffffffffu, upper = 0;
    for (std::uint32_t i = 0; i < leaf.locals; ++i) {
      const auto at = static_cast<std::uint32_t>(offset[leaf.vertex[i]][k]);
      lower = std::min(lower, at);
      upper = std::max(upper, at);
    }
    planes[2 * k] = static_cast<std::uint8_t>(lower >> shift[k]);
    planes[2 * k + 1] = static_cast<std::uint8_t>((upper + (1u << shift[k]) - 1u) >> shift[k]);
  }
}

}  // namespace hccm
