// What a pixel shows, free of light's noise: albedo, normal and place of the first surface that is
// not a mirror or clear glass. Guides the filter, and is written as layers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// Of one sample; all zero where no surface was met.
struct Feature {
  vec3 albedo{0.0f};       ///< reflectance of the broad lobes, [0, 1]; one for metals
  vec3 normal{0.0f};       ///< shading normal towards the viewer
  vec3 position{0.0f};     ///< render space, metres
  float footprint = 0.0f;  ///< width of a pixel at that place, metres
  float black = 0.0f;      ///< 1 if it reflects nothing, as what is unlit
};

/// The first surface of a sample, whatever it is made of.
struct FirstHit {
  static constexpr float kNothing = -1.0f;
  float depth = kNothing;   ///< metres along the viewing direction
  float object = kNothing;  ///< numbers; exact below 2^24
  float material = kNothing;
};

/// Means of features over the samples of each pixel, and the mean and spread of the light that may
/// be filtered. One pixel by one thread at a time.
class FeatureImage {
 public:
  FeatureImage(std::uint32_t width, std::uint32_t height)
      : width_(width), height_(height), pixels_(std::size_t{width} * height) {}

  /// `light`: of the sample, without what is seen of emitters (PathSample::own).
  void add(std::uint32_t x, std::uint32_t y, const Feature& f, const vec3& light = vec3(0.0f)) {
    Pixel& pixel = pixels_[std::size_t{y} * width_ + x];
    pixel.count += 1.0f;
    const float weight = 1.0f / pixel.count;
    Feature& mean = pixel.mean;
    mean.albedo += (f.albedo - mean.albedo) * weight;
    mean.normal += (f.normal - mean.normal) * weight;
    mean.position += (f.position - mean.position) * weight;
    mean.footprint += (f.footprint - mean.footprint) * weight;
    mean.black += (f.black - mean.black) * weight;
    const vec3 delta = light - pixel.light;  // Welford's recurrence
    pixel.light += delta * weight;
    pixel.spread += delta * (light - pixel.light);
  }
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[std::size_t{y} * width_ + x] = {}; }
  /// Means of a pixel; the normal is not made unit again.
  const Feature& mean(std::uint32_t x, std::uint32_t y) const {
    return pixels_[std::size_t{y} * width_ + x].mean;
  }
  /// Mean of the light of a pixel.
  const vec3& light(std::uint32_t x, std::uint32_t y) const {
    return pixels_[std::size_t{y} * width_ + x].light;
  }
  /// Unbiased variance of that mean; 0 below two samples.
  vec3 lightVariance(std::uint32_t x, std::uint32_t y) const {
    const Pixel& pixel = pixels_[std::size_t{y} * width_ + x];
    return pixel.spread / std::max(pixel.count * (pixel.count - 1.0f), 1.0f);
  }
  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height) {
    return std::uint64_t{width} * height * sizeof(Pixel);
  }
  /// The state, to be saved and put back.
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }

 private:
  struct Pixel {
    Feature mean;
    vec3 light{0.0f}, spread{0.0f};
    float count = 0.0f;
  };
  std::uint32_t width_, height_;
  std::vector<Pixel> pixels_;
};

}  // namespace trex
