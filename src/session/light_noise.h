// Another draw of the noise that the samples of pixels leave in their mean light: each sample's
// difference from the mean with a sign by chance (the wild bootstrap [Wu 1986]). Unlike a normal
// deviate of the same variance it has the samples' own distribution: rare bright ones stay rare and
// bright, channels go together. A draw does not know that samples are stratified, as their spread
// does not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/core/sampler.h"

namespace trex {

/// Sums of the samples so far. One pixel by one thread at a time.
class LightNoise {
 public:
  LightNoise(std::uint32_t width, std::uint32_t height)
      : width_(width), pixels_(std::size_t{width} * height) {}

  /// A finite sample of a pixel. Of two in a row one has each sign.
  void add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& light) {
    const std::uint32_t chance = hashCombine(hashCombine(x, y), sample / 2 + kSalt);
    const float sign = ((chance ^ sample) & 1u) != 0 ? 1.0f : -1.0f;
    Pixel& pixel = at(x, y);
    pixel.sum += sign * light;
    pixel.signs += sign;
  }
  void restart(std::uint32_t x, std::uint32_t y) { at(x, y) = {}; }
  /// Of a pixel whose `count` samples have this mean: expectation 0, and the variance of the mean.
  vec3 draw(std::uint32_t x, std::uint32_t y, const vec3& mean, float count) const {
    const Pixel& pixel = pixels_[std::size_t{y} * width_ + x];
    return count > 0.0f ? (pixel.sum - pixel.signs * mean) / count : vec3(0.0f);
  }

  /// The sums, to be saved and put back.
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height) {
    return std::uint64_t{width} * height * sizeof(Pixel);
  }

 private:
  static constexpr std::uint32_t kSalt = 0x6e6f6973u;
  struct Pixel {
    vec3 sum{0.0f};
    float signs = 0.0f;  ///< their sum
  };
  Pixel& at(std::uint32_t x, std::uint32_t y) { return pixels_[std::size_t{y} * width_ + x]; }

  std::uint32_t width_;
  std::vector<Pixel> pixels_;
};

}  // namespace trex
