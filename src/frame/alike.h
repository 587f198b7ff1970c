// How much of their light two surfaces share, for filters.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "src/frame/denoise_kernels.h"

namespace trex {

/// exp(-x) for x >= 0, within 2e-4 of itself; as in the kernels, so that all processors agree.
inline float expOfMinus(float x) {
  if (!(x < kFarApart)) return 0.0f;
  const float y = x * -1.44269504f;
  const float whole = std::floor(y);
  const float f = y - whole;
  const float mantissa = 1.0f + f * (0.695976f + f * (0.226163f + f * 0.0778610f));
  return std::bit_cast<float>(std::bit_cast<std::int32_t>(mantissa) +
                              (static_cast<std::int32_t>(whole) << 23));
}

/// What a pixel shows: a unit normal, a place in metres, and slopeOf() the pixel.
struct Shown {
  vec3 normal, position;
  float slope;
};

/// How much two surfaces share, as guideDistances() has it, whatever their albedo; `perPixel`: one
/// over their distance in pixels.
inline float alike(const Shown& a, const Shown& b, float perPixel) {
  const float cosine = std::min(glm::dot(a.normal, b.normal), 1.0f);
  if (!(cosine > 0.5f)) return 0.0f;
  const float c2 = cosine * cosine;
  const vec3 between = b.position - a.position;
  const float off = std::abs(glm::dot(a.normal, between)) * a.slope +
                    std::abs(glm::dot(b.normal, between)) * b.slope;
  return c2 * c2 * expOfMinus(0.5f * perPixel * off);
}

}  // namespace trex
