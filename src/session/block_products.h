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

/// Sum of estimates of parts of a picture, whose noises have nothing in common, and its standard
/// error as their spread tells it. Where few of them outweigh all others they do so in both, so
/// that the sum stands out of its error (standsOut()) by chance no more often than a normal
/// deviate, whatever the distribution of the parts [Student; Efron 1969]. A variance that is known
/// from elsewhere would miss what no part has met yet.
struct SpreadSum {
  double sum = 0.0, squares = 0.0, parts = 0.0;
  void add(double part) { add({part, part * part, 1.0}); }
  void add(const SpreadSum& o) {
    sum += o.sum;
    squares += o.squares;
    parts += o.parts;
  }
  /// Of one part alone: as large as itself.
  double doubt() const {
    if (parts < 2.0) return std::abs(sum);
    const double off = std::max(squares - sum * sum / parts, 0.0);
    return std::sqrt(off * parts / (parts - 1.0));
  }
};

/// Sum over the pixels of the weighed square of what is even in blocks of side x side pixels, and
/// its standard error. `weigh`: by pixel, row by row; mean(i): of pixel i, whose noise no other
/// shares. By all threads, with the same bits for any number of them.
template <typename Mean>
BiasFigures blockProducts(std::uint32_t width, std::uint32_t height, std::uint32_t side,
                          std::span<const vec3> weigh, const Mean& mean) {
  const auto rowOfBlocks = [&](std::uint32_t row, SpreadSum& sums) {
    const std::uint32_t top = row * side;
    for (std::uint32_t left = 0; left < width; left += side) {
      vec3 sum(0.0f), own(0.0f), w(0.0f);
      float count = 0.0f;
      for (std::uint32_t y = top; y < std::min(top + side, height); ++y) {
        for (std::uint32_t x = left; x < std::min(left + side, width); ++x) {
          const std::size_t i = std::size_t{y} * width + x;
          const vec3 value = mean(i);
          sum += value;
          own += value * value;
          w += weigh[i];
          count += 1.0f;
        }
      }
      if (count < 2.0f) continue;
      const vec3 scale = w / (count * (count - 1.0f));  // of the mean weight, for all pixels
      sums.add(static_cast<double>(glm::dot(scale, sum * sum - own)));
    }
  };
  const auto all = sumOfRows<SpreadSum>((height + side - 1) / side, rowOfBlocks);
  return {all.sum, all.doubt()};
}

}  // namespace trex
