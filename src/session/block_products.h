// Products of different pixels of a block: what their values have in common, squared, whatever the
// noise of each.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

#include "src/core/maths.h"
#include "src/session/rows.h"
#include "src/session/share_rule.h"

namespace trex {

/// Sum over the pixels of the weighed square of what is even in blocks of side x side pixels, and
/// its standard error. `weigh`: by pixel, row by row; mean(i) and variance(i): of pixel i, whose
/// noise no other shares. By all threads, with the same bits for any number of them.
template <typename Mean, typename Variance>
BiasFigures blockProducts(std::uint32_t width, std::uint32_t height, std::uint32_t side,
                          std::span<const vec3> weigh, const Mean& mean, const Variance& variance) {
  struct Sums {
    double square = 0.0, doubt = 0.0;
    void add(const Sums& o) {
      square += o.square;
      doubt += o.doubt;
    }
  };
  const auto all = sumOfRows<Sums>((height + side - 1) / side, [&](std::uint32_t row, Sums& sums) {
    const std::uint32_t top = row * side;
    for (std::uint32_t left = 0; left < width; left += side) {
      vec3 sum(0.0f), own(0.0f), noise(0.0f), w(0.0f);
      float count = 0.0f;
      for (std::uint32_t y = top; y < std::min(top + side, height); ++y) {
        for (std::uint32_t x = left; x < std::min(left + side, width); ++x) {
          const std::size_t i = std::size_t{y} * width + x;
          const vec3 value = mean(i);
          sum += value;
          own += value * value;
          noise += variance(i);
          w += weigh[i];
          count += 1.0f;
        }
      }
      if (count < 2.0f) continue;
      const vec3 scale = w / (count * (count - 1.0f));  // of the mean weight, for all pixels
      sums.square += static_cast<double>(glm::dot(scale, sum * sum - own));
      sums.doubt += 2.0 * static_cast<double>(glm::dot(scale * noise, scale * noise));
    }
  });
  return {all.square, std::sqrt(all.doubt)};
}

}  // namespace trex
