// Separable filters over planes of floats.
#pragma once

#include <cstdint>
#include <vector>

namespace trex {

/// One number a pixel, rows from top to bottom.
struct Plane {
  std::uint32_t width = 0, height = 0;
  std::vector<float> values;

  Plane() = default;
  Plane(std::uint32_t w, std::uint32_t h)
      : width(w), height(h), values(static_cast<std::size_t>(w) * h) {}
  float* row(std::uint32_t y) { return values.data() + static_cast<std::size_t>(y) * width; }
  const float* row(std::uint32_t y) const {
    return values.data() + static_cast<std::size_t>(y) * width;
  }
};

/// An odd number of taps; the middle one is the pixel itself.
using Kernel = std::vector<float>;

/// Correlation with `across` along rows, then with `down` along columns. Beyond the border the
/// nearest pixel is repeated. Uses the calling oneTBB arena; equal bits for any number of threads.
Plane filterRows(const Plane& in, const Kernel& across);
Plane filterColumns(const Plane& in, const Kernel& down);

}  // namespace trex
