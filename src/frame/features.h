// What a pixel shows, free of light's noise: albedo, normal and place of the first surface that is
// not a mirror or clear glass. Guides the filter, and is written as layers.
//
// At rims, and on glass that reflects too, a pixel shows two surfaces. The mean of them is a
// surface that is nowhere, and their light has nothing in common: so samples of each are kept
// apart, with their light.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "src/core/maths.h"
#include "src/core/memory.h"

namespace trex {

/// What light is divided by to be without texture.
inline vec3 guideAlbedo(const vec3& albedo) {
  constexpr float kLeastAlbedo = 0.02f;
  return glm::max(albedo, vec3(kLeastAlbedo));
}

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

/// Samples of a pixel that show one surface: means of their features, mean and spread of the light
/// that may be filtered.
struct FeaturePart {
  Feature mean;  ///< the normal is not made unit again
  vec3 light{0.0f}, spread{0.0f};
  float count = 0.0f;

  /// A sample, or one that counts as `of` samples.
  void add(const Feature& f, const vec3& ofLight, float of = 1.0f) {
    count += of;
    const float weight = of / count;
    mean.albedo += (f.albedo - mean.albedo) * weight;
    mean.normal += (f.normal - mean.normal) * weight;
    mean.position += (f.position - mean.position) * weight;
    mean.footprint += (f.footprint - mean.footprint) * weight;
    mean.black += (f.black - mean.black) * weight;
    const vec3 delta = ofLight - light;  // Welford's recurrence
    light += delta * weight;
    spread += delta * (ofLight - light) * of;
  }
  /// Takes in samples of another pixel, if they show the same surface: their light, and the albedo
  /// that it is of. The place stays.
  void join(const FeaturePart& other);
  /// Unbiased variance of the mean light; 0 below two samples.
  vec3 variance() const { return spread / std::max(count * (count - 1.0f), 1.0f); }
  /// Whether its light is that of a surface which scatters some.
  bool scatters() const { return mean.normal != vec3(0.0f) && mean.black < 1.0f; }
  /// Whether a sample shows the same surface.
  bool shows(const Feature& f) const {
    constexpr float kMostPixels = 2.0f;  // off the surface's plane
    constexpr float kLeastCosine2 = 0.5f;
    const float own = glm::dot(mean.normal, mean.normal), other = glm::dot(f.normal, f.normal);
    if (own == 0.0f || other == 0.0f || mean.black != f.black) {
      return (own == 0.0f) == (other == 0.0f) && mean.black == f.black;
    }
    const float cosine = glm::dot(mean.normal, f.normal);
    if (cosine <= 0.0f || cosine * cosine < kLeastCosine2 * own * other) return false;
    const float most = kMostPixels * std::max(mean.footprint, f.footprint);
    const float off = glm::dot(f.normal, f.position - mean.position);
    return off * off <= most * most * other;
  }
};

inline void FeaturePart::join(const FeaturePart& other) {
  if (other.count == 0.0f || !shows(other.mean)) return;
  const float all = count + other.count, share = other.count / all;
  const vec3 delta = other.light - light;  // [Chan, Golub, LeVeque 1983]
  light += delta * share;
  spread += other.spread + delta * delta * (count * share);
  mean.albedo += (other.mean.albedo - mean.albedo) * share;
  count = all;
}

/// The samples of each pixel, in two parts: the surface that most of them show, and the rest. One
/// pixel by one thread at a time.
class FeatureImage {
 public:
  FeatureImage(std::uint32_t width, std::uint32_t height)
      : width_(width), height_(height), pixels_(std::size_t{width} * height) {}

  /// `light`: of the sample, without what is seen of emitters (PathSample::own).
  void add(std::uint32_t x, std::uint32_t y, const Feature& f, const vec3& light = vec3(0.0f),
           float of = 1.0f) {
    auto& [most, rest] = pixels_[index(x, y)];
    (most.count == 0.0f || most.shows(f) ? most : rest).add(f, light, of);
    if (rest.count > most.count) std::swap(most, rest);
  }
  /// Adds to the mean light of each surface of a pixel.
  void addLight(std::uint32_t x, std::uint32_t y, const vec3& light) {
    auto& [most, rest] = pixels_[index(x, y)];
    most.light += light;
    rest.light += light;
  }
  void restart(std::uint32_t x, std::uint32_t y) { pixels_[index(x, y)] = {}; }
  /// A pixel that shows one surface.
  void put(std::uint32_t x, std::uint32_t y, const FeaturePart& part) {
    pixels_[index(x, y)] = {part, {}};
  }
  /// The pixel of another image, `wider` times as wide.
  void copy(std::uint32_t x, std::uint32_t y, const FeatureImage& from, std::uint32_t fromX,
            std::uint32_t fromY, float wider) {
    Pixel& pixel = pixels_[index(x, y)] = from.pixels_[from.index(fromX, fromY)];
    pixel.most.mean.footprint *= wider;
    pixel.rest.mean.footprint *= wider;
  }

  const FeaturePart& most(std::uint32_t x, std::uint32_t y) const {
    return pixels_[index(x, y)].most;
  }
  /// Empty where all samples show the same.
  const FeaturePart& rest(std::uint32_t x, std::uint32_t y) const {
    return pixels_[index(x, y)].rest;
  }
  /// Of those that scatter light the one with more samples; most() if there is none.
  const FeaturePart& surface(std::uint32_t x, std::uint32_t y) const {
    const auto& [most, rest] = pixels_[index(x, y)];
    return rest.scatters() && !most.scatters() ? rest : most;
  }
  /// Share of the samples in most().
  float shareOfMost(std::uint32_t x, std::uint32_t y) const {
    const auto& [most, rest] = pixels_[index(x, y)];
    return rest.count == 0.0f ? 1.0f : most.count / (most.count + rest.count);
  }
  /// Share of the samples that show a surface which scatters light.
  float scattering(std::uint32_t x, std::uint32_t y) const {
    const auto& [most, rest] = pixels_[index(x, y)];
    const float lit = (most.scatters() ? most.count : 0.0f) + (rest.scatters() ? rest.count : 0.0f);
    return lit / std::max(most.count + rest.count, 1.0f);
  }

  /// Means over all samples.
  Feature mean(std::uint32_t x, std::uint32_t y) const {
    const auto& [most, rest] = pixels_[index(x, y)];
    if (rest.count == 0.0f) return most.mean;
    const float w = rest.count / (most.count + rest.count);
    const Feature &a = most.mean, &b = rest.mean;
    return {glm::mix(a.albedo, b.albedo, w), glm::mix(a.normal, b.normal, w),
            glm::mix(a.position, b.position, w), glm::mix(a.footprint, b.footprint, w),
            glm::mix(a.black, b.black, w)};
  }
  vec3 light(std::uint32_t x, std::uint32_t y) const {
    const auto& [most, rest] = pixels_[index(x, y)];
    if (rest.count == 0.0f) return most.light;
    return glm::mix(most.light, rest.light, rest.count / (most.count + rest.count));
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
    FeaturePart most, rest;
  };
  std::size_t index(std::uint32_t x, std::uint32_t y) const { return std::size_t{y} * width_ + x; }

  std::uint32_t width_, height_;
  LargeVector<Pixel> pixels_;
};

}  // namespace trex
