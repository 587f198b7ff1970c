#include "src/frame/denoise.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr int kIterations = 5;           // steps of 1, 2, 4, 8, 16 pixels
constexpr float kTolerance = 2.0f;       // differences below this many deviations are noise
constexpr float kPlaneTolerance = 1.0f;  // pixel widths off the surface's plane
constexpr float kNormalPower = 32.0f;
constexpr float kAlbedoTolerance = 0.1f;
constexpr float kLeastAlbedo = 0.02f;

/// One pixel as the filter sees it: light without texture, its variance, and guides.
struct Cell {
  vec3 light{0.0f};
  float variance = 0.0f;  // of the light's luminance
  vec3 albedo{0.0f}, normal{0.0f}, position{0.0f};
  float footprint = 0.0f;
};

class Filter {
 public:
  Filter(const FeatureImage& features, const std::vector<vec3>& radiance,
         const std::vector<vec3>& variance)
      : width_(static_cast<int>(features.width())),
        height_(static_cast<int>(features.height())),
        cells_(radiance.size()),
        next_(radiance.size()) {
    tbb::parallel_for(0, height_, [&](int y) {
      for (int x = 0; x < width_; ++x) {
        const std::size_t i = index(x, y);
        const Feature f =
            features.mean(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y));
        Cell& cell = cells_[i];
        cell.albedo = glm::max(f.albedo, vec3(kLeastAlbedo));
        cell.light = radiance[i] / cell.albedo;
        const vec3 spread = variance[i] / (cell.albedo * cell.albedo);
        cell.variance = luminance(spread);
        cell.normal = f.normal;
        cell.position = f.position;
        cell.footprint = f.footprint;
      }
    });
  }

  std::vector<vec3> run() {
    smoothVariance();
    for (int step = 1; step < 1 << kIterations; step *= 2) {
      tbb::parallel_for(0, height_, [&](int y) {
        for (int x = 0; x < width_; ++x) next_[index(x, y)] = gather(x, y, step);
      });
      cells_.swap(next_);
    }
    std::vector<vec3> out(cells_.size());
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = cells_[i].light * cells_[i].albedo;
    return out;
  }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }

  /// How much two pixels may share by what they show.
  static float guideWeight(const Cell& a, const Cell& b, float distance) {
    const float cosine = glm::dot(a.normal, b.normal);
    const float lengths = glm::length(a.normal) * glm::length(b.normal);
    if (lengths < 1e-3f) return lengths == glm::dot(a.normal, a.normal) ? 1.0f : 0.0f;
    if (cosine <= 0.0f) return 0.0f;
    const float off = std::abs(glm::dot(a.normal, b.position - a.position));
    const float plane = off / (kPlaneTolerance * a.footprint * distance + 1e-30f);
    const vec3 colour = a.albedo - b.albedo;
    const float albedo = glm::dot(colour, colour) / (kAlbedoTolerance * kAlbedoTolerance);
    return std::pow(std::min(cosine / lengths, 1.0f), kNormalPower) * std::exp(-plane - albedo);
  }

  /// A variance from few samples is itself noise and rarely too large: the mean over a
  /// neighbourhood bounds it from below.
  void smoothVariance() {
    std::vector<float> smooth(cells_.size());
    tbb::parallel_for(0, height_, [&](int y) {
      for (int x = 0; x < width_; ++x) {
        const Cell& centre = cells_[index(x, y)];
        float sum = 0.0f, weights = 0.0f;
        for (int dy = -2; dy <= 2; ++dy) {
          for (int dx = -2; dx <= 2; ++dx) {
            const int px = x + dx, py = y + dy;
            if (px < 0 || py < 0 || px >= width_ || py >= height_) continue;
            const Cell& other = cells_[index(px, py)];
            const float w = dx == 0 && dy == 0 ? 1.0f : guideWeight(centre, other, 3.0f);
            sum += w * other.variance;
            weights += w;
          }
        }
        smooth[index(x, y)] = sum / weights;
      }
    });
    for (std::size_t i = 0; i < smooth.size(); ++i) {
      cells_[i].variance = std::max(cells_[i].variance, smooth[i]);
    }
  }

  Cell gather(int x, int y, int step) const {
    constexpr float kSpline[3] = {3.0f / 8.0f, 1.0f / 4.0f, 1.0f / 16.0f};
    const Cell& centre = cells_[index(x, y)];
    Cell out = centre;
    vec3 light(0.0f);
    float variance = 0.0f, weights = 0.0f;
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dx = -2; dx <= 2; ++dx) {
        const int px = x + dx * step, py = y + dy * step;
        if (px < 0 || py < 0 || px >= width_ || py >= height_) continue;
        const Cell& other = cells_[index(px, py)];
        float w = kSpline[std::abs(dx)] * kSpline[std::abs(dy)];
        if (dx != 0 || dy != 0) {
          const float distance =
              static_cast<float>(step) * std::sqrt(static_cast<float>(dx * dx + dy * dy));
          w *= guideWeight(centre, other, distance);
          if (w < 1e-6f) continue;
          const float difference = luminance(centre.light) - luminance(other.light);
          const float noise = centre.variance + other.variance;
          w *= std::exp(-difference * difference / (kTolerance * kTolerance * noise + 1e-30f));
        }
        light += w * other.light;
        variance += w * w * other.variance;
        weights += w;
      }
    }
    out.light = light / weights;
    out.variance = variance / (weights * weights);
    return out;
  }

  int width_, height_;
  std::vector<Cell> cells_, next_;
};

}  // namespace

std::vector<vec3> denoiseGuess(const FeatureImage& features, const std::vector<vec3>& radiance,
                               const std::vector<vec3>& variance) {
  return Filter(features, radiance, variance).run();
}

}  // namespace trex
