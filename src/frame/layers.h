// Layers of a picture besides R, G, B: which ones are wanted, and what they need of each sample.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "src/core/maths.h"
#include "src/core/memory.h"
#include "src/frame/features.h"

namespace trex {

/// The layers that are wanted. Directions and places are in render space: world axes, metres from
/// the scene's render origin.
struct PictureLayers {
  bool alpha = false;       ///< A: share of the pixel that something covers (PathSample::alpha)
  bool direct = false;      ///< direct.R .G .B: light scattered at most once; mirrors don't count
  bool indirect = false;    ///< indirect.R .G .B: the rest; direct + indirect = the unfiltered mean
  bool albedo = false;      ///< albedo.R .G .B: of the first surface that is no mirror or glass
  bool normal = false;      ///< normal.X .Y .Z: of the same
  bool position = false;    ///< position.X .Y .Z: of the same
  bool depth = false;       ///< depth: metres along the viewing direction; -1 where nothing is
  bool objectId = false;    ///< objectId: of the first surface of the first sample; -1: nothing
  bool materialId = false;  ///< materialId: likewise
  bool sampleCount = false;  ///< sampleCount
  bool variance = false;     ///< variance.R .G .B: of the mean, before any filter
  bool exactShare = false;   ///< exactShare: of the samples, those that exact paths are known of
  bool rayClass = false;     ///< rays by class, for the screen alone: in no file

  bool needsFeatures() const { return albedo || normal || position; }
  bool needsSplit() const { return direct || indirect; }
  bool needsFirstHit() const { return depth || objectId || materialId; }
  /// Values of a pixel that these layers add.
  std::size_t channels() const;
};

/// Names that layersFromNames() knows, in the order of the file.
const std::vector<std::string>& layerNames();

/// Throws Error(kUsage) for a name that is not in layerNames() and not "all".
PictureLayers layersFromNames(const std::vector<std::string>& names);

/// Sums of the direct part of each pixel: of the guess, and of what exact paths add to it.
class DirectImage {
 public:
  DirectImage(std::uint32_t width, std::uint32_t height)
      : width_(width), pixels_(std::size_t{width} * height) {}
  /// `exact` is null where the sample has no exact path.
  void add(std::uint32_t x, std::uint32_t y, const vec3& guess, const vec3* exact) {
    Pixel& p = pixels_[std::size_t{y} * width_ + x];
    p.guess += dvec3(guess);
    p.count += 1.0;
    if (exact == nullptr) return;
    p.difference += dvec3(*exact - guess);
    p.pairs += 1.0;
  }
  dvec3 mean(std::uint32_t x, std::uint32_t y) const {
    const Pixel& p = pixels_[std::size_t{y} * width_ + x];
    return guess(x, y) + (p.pairs > 0.0 ? p.difference / p.pairs : dvec3(0.0));
  }
  dvec3 guess(std::uint32_t x, std::uint32_t y) const {
    const Pixel& p = pixels_[std::size_t{y} * width_ + x];
    return p.count > 0.0 ? p.guess / p.count : dvec3(0.0);
  }
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[std::size_t{y} * width_ + x] = {}; }
  static constexpr std::uint64_t kBytesAPixel = 8 * sizeof(double);
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }

 private:
  struct Pixel {
    dvec3 guess{0.0}, difference{0.0};
    double count = 0.0, pairs = 0.0;
  };
  std::uint32_t width_;
  LargeVector<Pixel> pixels_;
};

/// Share of each pixel that something covers.
class CoverageImage {
 public:
  CoverageImage(std::uint32_t width, std::uint32_t height)
      : width_(width), pixels_(std::size_t{width} * height) {}
  void add(std::uint32_t x, std::uint32_t y, float alpha) {
    Pixel& p = pixels_[std::size_t{y} * width_ + x];
    p.sum += alpha;
    p.count += 1.0;
  }
  float mean(std::uint32_t x, std::uint32_t y) const {
    const Pixel& p = pixels_[std::size_t{y} * width_ + x];
    return p.count > 0.0 ? static_cast<float>(p.sum / p.count) : 0.0f;
  }
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[std::size_t{y} * width_ + x] = {}; }
  static constexpr std::uint64_t kBytesAPixel = 2 * sizeof(double);
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }

 private:
  struct Pixel {
    double sum = 0.0, count = 0.0;
  };
  std::uint32_t width_;
  LargeVector<Pixel> pixels_;
};

/// The first surface of each pixel: its mean depth, and the numbers that the first sample met.
class FirstHitImage {
 public:
  FirstHitImage(std::uint32_t width, std::uint32_t height)
      : width_(width), pixels_(std::size_t{width} * height) {}
  void add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const FirstHit& hit) {
    Pixel& p = pixels_[std::size_t{y} * width_ + x];
    if (sample == 0) {
      p.hit.object = hit.object;
      p.hit.material = hit.material;
    }
    if (hit.depth == FirstHit::kNothing) return;
    p.count += 1.0f;
    if (p.count == 1.0f) p.hit.depth = 0.0f;
    p.hit.depth += (hit.depth - p.hit.depth) / p.count;
  }
  const FirstHit& at(std::uint32_t x, std::uint32_t y) const {
    return pixels_[std::size_t{y} * width_ + x].hit;
  }
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[std::size_t{y} * width_ + x] = {}; }
  static constexpr std::uint64_t kBytesAPixel = 4 * sizeof(float);
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }

 private:
  struct Pixel {
    FirstHit hit;
    float count = 0.0f;
  };
  std::uint32_t width_;
  LargeVector<Pixel> pixels_;
};

/// Rays that the samples of each pixel took, by class.
class RayClassImage {
 public:
  RayClassImage(std::uint32_t width, std::uint32_t height)
      : width_(width), pixels_(std::size_t{width} * height) {}
  void add(std::uint32_t x, std::uint32_t y, float exact, float guessed) {
    vec2& p = pixels_[std::size_t{y} * width_ + x];
    p += vec2(exact, guessed);
  }
  void restart(std::uint32_t x, std::uint32_t y) {
    pixels_[std::size_t{y} * width_ + x] = vec2(0.0f);
  }
  /// C-rays and G-rays (cones and reads of cached light) so far.
  vec2 at(std::uint32_t x, std::uint32_t y) const { return pixels_[std::size_t{y} * width_ + x]; }

 private:
  std::uint32_t width_;
  LargeVector<vec2> pixels_;
};

}  // namespace trex
