// Random numbers keyed by (pixel, sample, dimension): no state is shared, so an image does not
// depend on threads or tile order.
//
// Each dimension is a Sobol' point, Owen-scrambled and shuffled by hashes [Burley, JCGT 2020]: the
// first two Sobol' dimensions are reused with a different shuffle for each pair (padding).
#pragma once

#include <algorithm>
#include <cstdint>

#include "src/core/maths.h"

namespace trex {

inline constexpr std::uint32_t kHashFactors[2] = {0x21f0aaadu, 0xd35a2d97u};

/// A 32-bit integer hash with good avalanche (the "lowbias32" constants of C. Wellons).
inline std::uint32_t hash32(std::uint32_t x) {
  x ^= x >> 16;
  x *= kHashFactors[0];
  x ^= x >> 15;
  x *= kHashFactors[1];
  x ^= x >> 15;
  return x;
}
inline std::uint32_t hashCombine(std::uint32_t seed, std::uint32_t value) {
  return hash32(seed ^ (value + 0x9e3779b9u + (seed << 6) + (seed >> 2)));
}

/// 24 random bits to [0, 1); the largest result is 1 - 2^-24.
inline float toUnitFloat(std::uint32_t bits) { return static_cast<float>(bits >> 8) * 0x1p-24f; }

inline std::uint32_t reverseBits(std::uint32_t x) {
  x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  return __builtin_bswap32(x);
}

/// The numbers of one sample of one pixel, dimension by dimension, drawn eight dimensions at a time
/// for the best instruction set of this processor (every one gives the same bits). Cheap to make;
/// a copy is 88 bytes, its State 12.
class Sampler {
 public:
  static constexpr std::uint32_t kBlock = 8;  ///< dimensions that are drawn together
  /// All that a sampler knows; `sample` has its bits reversed.
  struct State {
    std::uint32_t key, sample, dimension;
  };

  Sampler(std::uint32_t pixel, std::uint32_t sample, std::uint32_t seed)
      : state_{hashCombine(hashCombine(seed, 0x7265782du), pixel), reverseBits(sample), 0} {}
  explicit Sampler(const State& state) : state_(state) {}

  /// In [0, 1).
  float next1D() { return x_[next()]; }
  /// In [0, 1)^2, stratified in two dimensions over the samples of a pixel.
  vec2 next2D() {
    const std::uint32_t at = next();
    return vec2(x_[at], y_[at]);
  }
  /// Jumps to a dimension, so that two estimators of a sample share what follows.
  void setDimension(std::uint32_t dimension) { state_.dimension = dimension; }
  std::uint32_t dimension() const { return state_.dimension; }
  const State& state() const { return state_; }

 private:
  std::uint32_t next() {
    const std::uint32_t at = state_.dimension++ - first_;
    return at < kBlock ? at : refill();
  }
  std::uint32_t refill();

  State state_;
  std::uint32_t first_ = 0u - kBlock;  ///< dimension of x_[0]; this one: nothing is drawn yet
  alignas(32) float x_[kBlock];
  alignas(32) float y_[kBlock];
};

}  // namespace trex
