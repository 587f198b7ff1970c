// What a pixel shows, free of light's noise: albedo, normal and place of the first surface that is
// not a mirror or clear glass. Guides the filter, and is written as layers.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// Of one sample; all zero where no surface was met.
struct Feature {
  vec3 albedo{0.0f};       ///< reflectance of the broad lobes, [0, 1]; one for emitters and metals
  vec3 normal{0.0f};       ///< shading normal towards the viewer
  vec3 position{0.0f};     ///< render space, metres
  float footprint = 0.0f;  ///< width of a pixel at that place, metres
};

/// Sums of features over the samples of each pixel. One pixel by one thread at a time.
class FeatureImage {
 public:
  FeatureImage(std::uint32_t width, std::uint32_t height)
      : width_(width), height_(height), sums_(std::size_t{width} * height) {}

  void add(std::uint32_t x, std::uint32_t y, const Feature& f) {
    Sum& sum = sums_[std::size_t{y} * width_ + x];
    sum.feature.albedo += f.albedo;
    sum.feature.normal += f.normal;
    sum.feature.position += f.position;
    sum.feature.footprint += f.footprint;
    sum.count += 1.0f;
  }
  /// Means of a pixel; the normal is not made unit again.
  Feature mean(std::uint32_t x, std::uint32_t y) const {
    const Sum& sum = sums_[std::size_t{y} * width_ + x];
    const float scale = sum.count > 0.0f ? 1.0f / sum.count : 0.0f;
    return {sum.feature.albedo * scale, sum.feature.normal * scale, sum.feature.position * scale,
            sum.feature.footprint * scale};
  }
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height) {
    return std::uint64_t{width} * height * sizeof(Sum);
  }

 private:
  struct Sum {
    Feature feature;
    float count = 0.0f;
  };
  std::uint32_t width_, height_;
  std::vector<Sum> sums_;
};

}  // namespace trex
