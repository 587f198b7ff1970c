// The filtered correction: it finds a smooth bias in noise, leaves no trace of pure noise, and
// fades to the raw mean as the noise goes.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "src/frame/denoise.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 64;

/// One even surface.
FeatureImage wall() {
  FeatureImage features(kSide, kSide);
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      Feature f;
      f.albedo = vec3(0.5f);
      f.normal = vec3(0.0f, 0.0f, 1.0f);
      f.position = vec3(static_cast<float>(x), static_cast<float>(y), 0.0f);
      f.footprint = 1.0f;
      features.add(x, y, f);
    }
  }
  return features;
}

double smooth(std::size_t i) { return 0.2 * std::sin(0.1 * static_cast<double>(i % kSide)); }

struct Noisy {
  std::vector<vec3> mean, variance;
};

Noisy noisy(double deviation, bool signal) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, deviation);
  Noisy out;
  for (std::size_t i = 0; i < kSide * kSide; ++i) {
    out.mean.emplace_back(static_cast<float>((signal ? smooth(i) : 0.0) + noise(random)));
    out.variance.emplace_back(static_cast<float>(deviation * deviation));
  }
  return out;
}

double rmse(const std::vector<vec3>& picture, bool signal) {
  double sum = 0.0;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    const double d = static_cast<double>(picture[i].x) - (signal ? smooth(i) : 0.0);
    sum += d * d;
  }
  return std::sqrt(sum / static_cast<double>(picture.size()));
}

TEST(Correction, FindsASmoothBiasInNoise) {
  const Noisy raw = noisy(0.5, true);
  EXPECT_LT(rmse(denoiseCorrection(wall(), raw.mean, raw.variance), true),
            0.2 * rmse(raw.mean, true));
}

TEST(Correction, PureNoiseLeavesLittle) {
  const Noisy raw = noisy(0.5, false);
  EXPECT_LT(rmse(denoiseCorrection(wall(), raw.mean, raw.variance), false), 0.1);
}

TEST(Correction, FadesToTheMeanAsNoiseGoes) {
  double before = kInfinity;
  for (const double deviation : {1e-1, 1e-2, 1e-3, 1e-4}) {
    const Noisy raw = noisy(deviation, true);
    const double error = rmse(denoiseCorrection(wall(), raw.mean, raw.variance), true);
    EXPECT_LT(error, deviation);
    EXPECT_LT(error, 0.3 * before);
    before = error;
  }
  const Noisy exact = noisy(0.0, true);
  EXPECT_LT(rmse(denoiseCorrection(wall(), exact.mean, exact.variance), true), 1e-6);
}

}  // namespace
}  // namespace trex
