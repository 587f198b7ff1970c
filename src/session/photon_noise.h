// The noise that photons leave in cached light: the same for all samples, so that neither their
// spread nor the differences of few pairs show it.
//
// Where a path ends in cached light its sample also brings what the later half or so of the photons
// changed there (CachedLight::noisyIrradiance()): by the same path, so with the same weight. What
// all of a region has in common is one number, of which one draw tells little; of that each lot of
// the photons is a draw, and each pixel asks one (PhotonLots). The means are a picture of noise
// that is distributed as that of the guess is. Their own noise, of the paths, is none that pixels
// share; so the mean product of different pixels of a block that ask the same lot, in which the
// photons' noise counts as even, is its square. Cones bring nothing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// Light that samples read from number `first` on, and its photons.
struct SampleLight {
  std::uint32_t first = 0;
  std::uint64_t photons = 0;
  bool operator==(const SampleLight&) const = default;
};

/// Of the photons of light i, how many are the light that tells its noise: those of the light
/// before. Of the first one half of them if samples 0 to 15 read it alone, else none, 0.
std::uint64_t photonsBefore(std::span<const SampleLight> lights, std::uint64_t photons);

/// Variance of the mean light of the first `samples` samples, that of one photon being 1. Each
/// light has the photons of those before it, too.
double varianceOfLight(std::span<const SampleLight> lights, std::uint32_t samples);

/// Sums of the samples that read the last light. One pixel by one thread at a time.
class PhotonNoise {
 public:
  /// `lights`: of growing numbers, at least one.
  PhotonNoise(std::uint32_t width, std::uint32_t height, std::vector<SampleLight> lights)
      : width_(width), lights_(std::move(lights)), pixels_(std::size_t{width} * height) {}

  /// Of a sample; values that are not finite are dropped.
  void add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& noise);
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[std::size_t{y} * width_ + x] = {}; }
  /// Mean square of what photons leave in a picture of so many samples, `weigh` (by pixel) being
  /// what a square at each value weighs: relMSE. Of noise that is even in blocks of `side` pixels.
  double square(std::uint32_t samples, std::span<const vec3> weigh, std::uint32_t side) const;

  const std::vector<SampleLight>& lights() const { return lights_; }
  /// The sums, to be saved and put back.
  std::span<std::byte> bytes() { return std::as_writable_bytes(std::span(pixels_)); }
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height) {
    return std::uint64_t{width} * height * sizeof(Pixel);
  }

 private:
  struct Pixel {
    vec3 sum{0.0f};
    float count = 0.0f;  ///< of samples
    vec3 mean() const { return count > 0.0f ? sum / count : vec3(0.0f); }
  };

  std::uint32_t width_;
  std::vector<SampleLight> lights_;
  std::vector<Pixel> pixels_;
};

}  // namespace trex
