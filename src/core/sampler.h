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

/// A 32-bit integer hash with good avalanche (the "lowbias32" constants of C. Wellons).
inline std::uint32_t hash32(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x21f0aaadu;
  x ^= x >> 15;
  x *= 0xd35a2d97u;
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

/// Owen scrambling of a value in base 2 with its bits reversed, by a Laine-Karras style
/// permutation.
inline std::uint32_t owenScramble(std::uint32_t reversed, std::uint32_t seed) {
  std::uint32_t x = reversed;
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverseBits(x);
}

/// Second Sobol' dimension of index with its bits reversed (so the first is the index itself). Its
/// matrix is Pascal's triangle mod 2: by Lucas' theorem digit i is the sum of all index bits j that
/// contain i, a superset transform.
inline std::uint32_t sobolSecond(std::uint32_t index) {
  index ^= (index >> 1) & 0x55555555u;
  index ^= (index >> 2) & 0x33333333u;
  index ^= (index >> 4) & 0x0f0f0f0fu;
  index ^= (index >> 8) & 0x00ff00ffu;
  index ^= (index >> 16) & 0x0000ffffu;
  return index;
}

/// The numbers of one sample of one pixel, dimension by dimension. Cheap to make and to copy.
class Sampler {
 public:
  Sampler(std::uint32_t pixel, std::uint32_t sample, std::uint32_t seed)
      : key_(hashCombine(hashCombine(seed, 0x7265782du), pixel)), sample_(reverseBits(sample)) {}

  /// In [0, 1).
  float next1D() {
    const std::uint32_t key = hashCombine(key_, dimension_++);
    return toUnitFloat(owenScramble(shuffled(key), hash32(key ^ 0x5bd1e995u)));
  }
  /// In [0, 1)^2, stratified in two dimensions over the samples of a pixel.
  vec2 next2D() {
    const std::uint32_t key = hashCombine(key_, dimension_++);
    const std::uint32_t index = shuffled(key);
    const std::uint32_t x = owenScramble(index, hash32(key ^ 0x5bd1e995u));
    const std::uint32_t y = owenScramble(sobolSecond(index), hash32(key ^ 0xc2b2ae35u));
    return vec2(toUnitFloat(x), toUnitFloat(y));
  }
  /// Jumps to a dimension, so that two estimators of a sample share what follows.
  void setDimension(std::uint32_t dimension) { dimension_ = dimension; }
  std::uint32_t dimension() const { return dimension_; }

 private:
  std::uint32_t shuffled(std::uint32_t key) const { return owenScramble(sample_, key); }

  std::uint32_t key_, sample_, dimension_ = 0;  // the sample with its bits reversed
};

}  // namespace trex
