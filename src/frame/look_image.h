// What pixels show by their first few samples, whether these were taken or only looked at: edges
// and texture, free of light's noise, before there is light of every pixel.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "src/frame/features.h"

namespace trex {

/// One thread at a time adds; reading is thread safe while nobody does.
class LookImage {
 public:
  static constexpr std::uint32_t kMost = 8;  ///< of a pixel

  LookImage(std::uint32_t width, std::uint32_t height)
      : shown_(width, height), counts_(std::size_t{width} * height) {}

  /// All pixels are unknown again.
  void restart() { std::fill(counts_.begin(), counts_.end(), std::uint8_t{0}); }
  /// What sample `number` of a pixel shows, and the light that this sends out itself. Each number
  /// counts once, whoever was first; none before the one below it is there.
  void add(std::uint32_t x, std::uint32_t y, std::uint32_t number, const Feature& f,
           const vec3& own, float weight = 1.0f) {
    std::uint8_t& count = counts_[index(x, y)];
    if (number != count || count == kMost) return;
    if (count == 0) shown_.restart(x, y);
    shown_.add(x, y, f, own, weight);
    ++count;
  }
  /// Numbers that a pixel has.
  std::uint32_t count(std::uint32_t x, std::uint32_t y) const { return counts_[index(x, y)]; }
  /// Whether another one would tell more: the pixel and those beside it show several surfaces, or
  /// one whose texture or light of its own varies. Of known pixels.
  bool varied(std::uint32_t x, std::uint32_t y) const;
  /// Whether look `number`, above 0, is wanted: it is the next of a pixel where that tells more.
  /// Textures are worth four, rims and glass as many as there are.
  bool wants(std::uint32_t x, std::uint32_t y, std::uint32_t number) const {
    if (count(x, y) != number) return false;
    return number == 1 ? varied(x, y) : number < kOfTextures || several(x, y);
  }
  /// Whether a pixel shows several surfaces so far, or one side of glass.
  bool several(std::uint32_t x, std::uint32_t y) const {
    return shown_.most(x, y).count != static_cast<float>(count(x, y));
  }
  /// Means over the numbers of each pixel, in two parts; FeaturePart::light is the own light. Of
  /// known pixels.
  const FeatureImage& shown() const { return shown_; }
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height) {
    return FeatureImage::bytesNeeded(width, height) + std::uint64_t{width} * height;
  }

 private:
  static constexpr std::uint32_t kOfTextures = 4;
  std::size_t index(std::uint32_t x, std::uint32_t y) const {
    return std::size_t{y} * shown_.width() + x;
  }
  FeatureImage shown_;
  std::vector<std::uint8_t> counts_;
};

}  // namespace trex
