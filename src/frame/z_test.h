// Are two noisy pictures pictures of the same thing? The z-test of each pixel and of the means.
#pragma once

#include <array>
#include <cstdint>

#include "src/frame/image_file.h"

namespace trex {

/// z = (a - b) / sqrt(va + vb) of each pixel and channel, va and vb the variances of the means. Two
/// equal values without variance have z = 0, two different ones an infinite z.
struct ZTest {
  double within2 = 0.0, within3 = 0.0, within4 = 0.0;  ///< share with |z| below, [0, 1]
  double largest = 0.0;                                ///< |z|
  std::uint32_t largestX = 0, largestY = 0;
  /// p-value of the largest |z| among N: 1 - (1 - p)^N [Šidák 1967].
  double largestP = 1.0;
  std::array<double, 3> meanZ{};  ///< of the whole picture's mean, R, G, B; signed
  std::array<double, 3> meanP{1.0, 1.0, 1.0};
  double leastMeanP = 1.0;  ///< the least of meanP, corrected in the same way for three tests
};

/// Whether a picture has R, G, B and variance.R, .G, .B.
bool hasVariance(const Picture& picture);

/// Both pictures have variance, one size, and finite values. Negative variances count as 0. The
/// p-values are those of a normal distribution: with few samples a pixel they are too small.
ZTest zTest(const Picture& a, const Picture& b);

}  // namespace trex
