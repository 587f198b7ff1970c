// The filter of src/frame/denoise.h a pixel at a time, plainly: what tests compare with, and what
// the benchmark counts its gain from.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "src/frame/features.h"

namespace trex::test {

inline constexpr int kIterations = 5;           // steps of 1, 2, 4, 8, 16 pixels
inline constexpr float kTolerance = 3.0f;       // differences below this many deviations are noise
inline constexpr float kPlaneTolerance = 2.0f;  // pixel widths off the surface's plane
inline constexpr float kAlbedoTolerance = 0.2f;
inline constexpr float kLeastAlbedo = 0.02f;

// Of variances: they are estimates, too small where light is rare.
inline constexpr float kDoubt = 4.0f;
inline constexpr float kFar = 20.0f;  // exponents beyond count as infinite

/// exp(-x) for x >= 0, within 2e-4 of itself; 0 beyond kFar. A polynomial for the fraction of the
/// power of two, its integer part goes into the exponent's bits.
inline float expOfMinus(float x) {
  if (!(x < kFar)) return 0.0f;
  const float y = x * -1.44269504f;
  const float whole = std::floor(y);
  const float f = y - whole;
  const float mantissa = 1.0f + f * (0.695976f + f * (0.226163f + f * 0.0778610f));
  return std::bit_cast<float>(std::bit_cast<std::int32_t>(mantissa) +
                              (static_cast<std::int32_t>(whole) << 23));
}

/// What a pixel shows, for the weights. `length` is that of the mean normal: 0 shows nothing.
struct Guide {
  vec3 normal{0.0f};
  float length = 0.0f;
  vec3 position{0.0f};
  float perPixel = 0.0f;  // 1 / (kPlaneTolerance * footprint)
  vec3 albedo{0.0f};
};

/// Light without texture, and the variance of its luminance.
struct Cell {
  vec3 light{0.0f};
  float variance = 0.0f;
};

class ScalarFilter {
 public:
  ScalarFilter(const FeatureImage& features, const std::vector<vec3>& radiance,
               const std::vector<vec3>& variance)
      : width_(static_cast<int>(features.width())),
        height_(static_cast<int>(features.height())),
        guides_(radiance.size()),
        cells_(radiance.size()),
        next_(radiance.size()),
        raw_(radiance.size()) {
    tbb::parallel_for(0, height_, [&](int y) {
      for (int x = 0; x < width_; ++x) {
        const std::size_t i = index(x, y);
        const Feature& f =
            features.surface(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)).mean;
        Guide& guide = guides_[i];
        guide.albedo = glm::max(f.albedo, vec3(kLeastAlbedo));
        guide.length = glm::length(f.normal);
        if (guide.length > 0.0f) guide.normal = f.normal / guide.length;
        guide.position = f.position;
        guide.perPixel = 1.0f / (kPlaneTolerance * f.footprint + 1e-30f);
        const vec3 spread = variance[i] / (guide.albedo * guide.albedo);
        cells_[i] = {radiance[i] / guide.albedo, luminance(spread)};
        raw_[i] = cells_[i].light;
      }
    });
  }

  std::vector<vec3> run(bool shrink) {
    if (!shrink) calm();
    smoothVariance();
    for (int step = 1; step < 1 << kIterations; step *= 2) {
      tbb::parallel_for(0, height_, [&](int y) {
        for (int x = 0; x < width_; ++x) next_[index(x, y)] = gather(x, y, step);
      });
      cells_.swap(next_);
    }
    std::vector<vec3> out(cells_.size());
    std::vector<vec3> lost(cells_.size());
    if (!shrink) lost = givenBack();
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = cells_[i].light * guides_[i].albedo;
      if (!shrink) {
        out[i] = glm::max(cells_[i].light + lost[i], vec3(0.0f)) * guides_[i].albedo;
        continue;
      }
      const float value = luminance(cells_[i].light);
      const float square = value * value;
      out[i] *= square > 0.0f ? square / (square + kDoubt * cells_[i].variance) : 0.0f;
    }
    return out;
  }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }

  /// How little two pixels may share by what they show: their weight is power * exp(-returned
  /// value), where power is the 4th of the cosine between their normals.
  static float guideDistance(const Guide& a, const Guide& b, float inverseDistance, float& power) {
    if (a.length * b.length < 1e-3f) {
      power = 1.0f;
      return a.length == b.length ? 0.0f : kInfinity;
    }
    const float cosine = std::min(glm::dot(a.normal, b.normal), 1.0f);
    if (cosine <= 0.5f) return kInfinity;
    power = cosine * cosine * cosine * cosine;
    const vec3 between = b.position - a.position;
    const float off = std::abs(glm::dot(a.normal, between)) * a.length * a.perPixel +
                      std::abs(glm::dot(b.normal, between)) * b.length * b.perPixel;
    const vec3 colour = a.albedo - b.albedo;
    return 0.5f * off * inverseDistance +
           glm::dot(colour, colour) * (1.0f / (kAlbedoTolerance * kAlbedoTolerance));
  }

  /// Calls visit(offset index, pixel) for the 5x5 neighbours `step` apart that are in the picture.
  template <typename Visit>
  void neighbours(int x, int y, int step, Visit visit) const {
    for (int dy = -2; dy <= 2; ++dy) {
      const int py = y + dy * step;
      if (py < 0 || py >= height_) continue;
      for (int dx = -2; dx <= 2; ++dx) {
        const int px = x + dx * step;
        if (px < 0 || px >= width_) continue;
        visit(dx, dy, index(px, py));
      }
    }
  }

  /// What the filter took of each pixel's light, spread: all that a pixel has it shares out among
  /// the 3x3 pixels `step` apart, in proportion to weight times the luminance of their albedo.
  std::vector<vec3> givenBack() const {
    std::vector<vec3> lost(cells_.size());
    for (std::size_t i = 0; i < lost.size(); ++i) lost[i] = raw_[i] - cells_[i].light;
    for (int step = 1; step < 1 << kIterations; step *= 2) {
      std::vector<vec3> given(cells_.size(), vec3(0.0f));
      for (int y = 0; y < height_; ++y) {
        for (int x = 0; x < width_; ++x) {
          const std::size_t at = index(x, y);
          double all = 0.0;
          sharers(x, y, step, [&](std::size_t i, float w) {
            all += static_cast<double>(w * luminance(guides_[i].albedo));
          });
          const vec3 light = lost[at] * luminance(guides_[at].albedo) / static_cast<float>(all);
          sharers(x, y, step, [&](std::size_t i, float w) { given[i] += w * light; });
        }
      }
      lost = given;
    }
    return lost;
  }

  /// Calls visit(pixel, weight) for those that a pixel shares with.
  template <typename Visit>
  void sharers(int x, int y, int step, Visit visit) const {
    const std::size_t at = index(x, y);
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const int px = x + dx * step, py = y + dy * step;
        if (px < 0 || px >= width_ || py < 0 || py >= height_) continue;
        float w = (dx == 0 ? 0.5f : 0.25f) * (dy == 0 ? 0.5f : 0.25f);
        if (dx != 0 || dy != 0) {
          float power = 0.0f;
          const float pixels =
              static_cast<float>(step) * (dx != 0 && dy != 0 ? std::sqrt(2.0f) : 1.0f);
          const float far =
              guideDistance(guides_[at], guides_[index(px, py)], 1.0f / pixels, power);
          w *= power * expOfMinus(far);
        }
        visit(index(px, py), w);
      }
    }
  }

  /// A pixel brighter than all around it, by no more than its noise, counts as the brightest of
  /// them.
  void calm() {
    std::vector<vec3> calmed;
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        float most = 0.0f;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, height_ - 1); ++v) {
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width_ - 1); ++u) {
            if (u != x || v != y) most = std::max(most, luminance(cells_[index(u, v)].light));
          }
        }
        const Cell& own = cells_[index(x, y)];
        const float bright = luminance(own.light), over = bright - most;
        const bool noise = over * over < kTolerance * kTolerance * own.variance;
        calmed.push_back(over > 0.0f && most > 0.0f && noise ? own.light * (most / bright)
                                                             : own.light);
      }
    }
    for (std::size_t i = 0; i < calmed.size(); ++i) cells_[i].light = calmed[i];
  }

  /// A variance from few samples is itself noise and rarely too large: the mean over a
  /// neighbourhood bounds it from below.
  void smoothVariance() {
    std::vector<float> smooth(cells_.size());
    tbb::parallel_for(0, height_, [&](int y) {
      for (int x = 0; x < width_; ++x) {
        const std::size_t centre = index(x, y);
        float sum = 0.0f, weights = 0.0f;
        neighbours(x, y, 1, [&](int, int, std::size_t other) {
          float w = 1.0f;
          if (other != centre) {
            const float distance = guideDistance(guides_[centre], guides_[other], 1.0f / 3.0f, w);
            w *= expOfMinus(distance);
          }
          sum += w * cells_[other].variance;
          weights += w;
        });
        smooth[centre] = sum / weights;
      }
    });
    for (std::size_t i = 0; i < smooth.size(); ++i) {
      cells_[i].variance = std::max(cells_[i].variance, smooth[i]);
    }
  }

  Cell gather(int x, int y, int step) const {
    constexpr float kSpline[3] = {3.0f / 8.0f, 1.0f / 4.0f, 1.0f / 16.0f};
    // 1 / sqrt(dx^2 + dy^2) by the squared distance.
    constexpr float kInverse[9] = {0.0f,        1.0f, 0.70710678f, 0.0f,       0.5f,
                                   0.44721360f, 0.0f, 0.0f,        0.35355339f};
    const std::size_t at = index(x, y);
    const Cell& centre = cells_[at];
    const Guide& guide = guides_[at];
    const float inverseStep = 1.0f / static_cast<float>(step);
    const float bright = luminance(centre.light);
    vec3 light(0.0f);
    float variance = 0.0f, weights = 0.0f;
    neighbours(x, y, step, [&](int dx, int dy, std::size_t i) {
      const Cell& other = cells_[i];
      float w = kSpline[std::abs(dx)] * kSpline[std::abs(dy)];
      if (i != at) {
        float power = 0.0f;
        float far =
            guideDistance(guide, guides_[i], inverseStep * kInverse[dx * dx + dy * dy], power);
        if (!(far < kFar)) return;
        const float difference = bright - luminance(other.light);
        const float noise = 2.0f * centre.variance;
        far += difference * difference / (kTolerance * kTolerance * noise + 1e-30f);
        w *= power * expOfMinus(far);
      }
      light += w * other.light;
      variance += w * w * other.variance;
      weights += w;
    });
    return {light / weights, variance / (weights * weights)};
  }

  int width_, height_;
  std::vector<Guide> guides_;
  std::vector<Cell> cells_, next_;
  std::vector<vec3> raw_;
};

}  // namespace trex::test
