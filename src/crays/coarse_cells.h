// Where something is, a sixteenth of the scene wide: for what photons tell of their places.
#pragma once

#include <algorithm>
#include <cstdint>

#include "src/core/maths.h"

namespace trex {

/// Cells of a box, 16 each way. Places beside it count for the nearest.
struct CoarseCells {
  static constexpr std::uint32_t kSide = 16, kCount = kSide * kSide * kSide;
  Box3f bounds;

  std::uint32_t of(const vec3& position) const {
    std::uint32_t cell = 0;
    for (int axis = 2; axis >= 0; --axis) {
      const float size = bounds.upper[axis] - bounds.lower[axis];
      const float place = size > 0.0f ? (position[axis] - bounds.lower[axis]) / size : 0.0f;
      const float number = std::clamp(place, 0.0f, 1.0f) * kSide;
      cell = cell * kSide + std::min(static_cast<std::uint32_t>(number), kSide - 1);
    }
    return cell;
  }
};

}  // namespace trex
