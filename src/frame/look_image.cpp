#include "src/frame/look_image.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr float kSame = 0.1f;  // of albedos and of light, relative to the brighter
constexpr float kDark = 0.02f;

bool differ(const vec3& a, const vec3& b) {
  const float x = luminance(a), y = luminance(b);
  return std::abs(x - y) > kSame * std::max({x, y, kDark});
}

bool differ(const FeaturePart& a, const FeaturePart& b) {
  return !a.shows(b.mean) || differ(a.mean.albedo, b.mean.albedo) || differ(a.light, b.light);
}

}  // namespace

bool LookImage::varied(std::uint32_t x, std::uint32_t y) const {
  if (several(x, y)) return true;
  const FeaturePart& own = shown_.most(x, y);
  const auto other = [&](std::uint32_t u, std::uint32_t v) {
    return counts_[index(u, v)] > 0 &&
           (shown_.rest(u, v).count > 0.0f || differ(own, shown_.most(u, v)));
  };
  return (x > 0 && other(x - 1, y)) || (x + 1 < shown_.width() && other(x + 1, y)) ||
         (y > 0 && other(x, y - 1)) || (y + 1 < shown_.height() && other(x, y + 1));
}

}  // namespace trex
