// Products of different pixels of a block: what their values have in common, squared, whatever the
// noise of each.
#pragma once

#include <algorithm>
#include <array>
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
/// shares. Pixels are of kKinds kinds, kindOf(x, y), and only those of one kind are multiplied. By
/// all threads, with the same bits for any number of them.
template <std::uint32_t kKinds, typename Mean, typename Kind>
BiasFigures blockProducts(std::uint32_t width, std::uint32_t height, std::uint32_t side,
                          std::span<const vec3> weigh, const Mean& mean, const Kind& kindOf) {
  const auto rowOfBlocks = [&](std::uint32_t row, SpreadSum& sums) {
    const std::uint32_t top = row * side;
    for (std::uint32_t left = 0; left < width; left += side) {
      std::array<vec3, kKinds> sum{};
      std::array<float, kKinds> count{};
      vec3 own(0.0f), w(0.0f);
      for (std::uint32_t y = top; y < std::min(top + side, height); ++y) {
        for (std::uint32_t x = left; x < std::min(left + side, width); ++x) {
          const std::size_t i = std::size_t{y} * width + x;
          const vec3 value = mean(i);
          const std::uint32_t kind = kindOf(x, y);
          sum[kind] += value;
          own += value * value;
          w += weigh[i];
          count[kind] += 1.0f;
        }
      }
      vec3 products = -own;
      float pairs = 0.0f;
      for (std::uint32_t kind = 0; kind < kKinds; ++kind) {
        products += sum[kind] * sum[kind];
        pairs += count[kind] * (count[kind] - 1.0f);
      }
      if (!(pairs > 0.0f)) continue;
      // Of the mean weight, for all pixels.
      sums.add(static_cast<double>(glm::dot(w / pairs, products)));
    }
  };
  const auto all = sumOfRows<SpreadSum>((height + side - 1) / side, rowOfBlocks);
  return {all.sum, all.doubt()};
}

/// All pixels are of one kind.
template <typename Mean>
BiasFigures blockProducts(std::uint32_t width, std::uint32_t height, std::uint32_t side,
                          std::span<const vec3> weigh, const Mean& mean) {
  return blockProducts<1>(width, height, side, weigh, mean,
                          [](std::uint32_t, std::uint32_t) { return 0u; });
}

}  // namespace trex
