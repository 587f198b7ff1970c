#include "src/frame/denoise.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

namespace trex {
namespace {

constexpr std::uint32_t kWidth = 48, kHeight = 32;

/// Two walls that meet in the middle: left lit with 1, right with 3; striped albedo.
struct Corner {
  FeatureImage features{kWidth, kHeight};
  std::vector<vec3> truth;

  Corner() {
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x) {
        const bool left = x < kWidth / 2;
        const float albedo = (x / 4) % 2 ? 0.8f : 0.2f;
        const vec3 normal = left ? vec3(1, 0, 0) : vec3(0, 0, 1);
        const vec3 position(left ? 0.0f : 0.1f * (static_cast<float>(x) - kWidth / 2.0f),
                            0.1f * static_cast<float>(y),
                            left ? 0.1f * (kWidth / 2.0f - static_cast<float>(x)) : 0.0f);
        features.add(x, y, {vec3(albedo), normal, position, 0.1f});
        truth.emplace_back(albedo * (left ? 1.0f : 3.0f));
      }
    }
  }
};

double meanSquare(const std::vector<vec3>& a, const std::vector<vec3>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += static_cast<double>(glm::dot(a[i] - b[i], a[i] - b[i]));
  return sum / static_cast<double>(a.size());
}

TEST(Denoise, RemovesNoiseAndKeepsEdgesAndTexture) {
  const Corner corner;
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0.0f, 0.3f);
  std::vector<vec3> noisy, variance;
  for (const vec3& t : corner.truth) {
    noisy.push_back(t * (1.0f + noise(random)));
    variance.push_back(t * t * 0.09f);
  }
  const std::vector<vec3> out = denoiseGuess(corner.features, noisy, variance);
  EXPECT_LT(meanSquare(out, corner.truth), 0.05 * meanSquare(noisy, corner.truth));
  // The mean light of each wall stays as it came: nothing flows over the edge.
  for (std::uint32_t from : {0u, kWidth / 2}) {
    double before = 0.0, after = 0.0;
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = from; x < from + kWidth / 2; ++x) {
        before += static_cast<double>(noisy[y * kWidth + x].x);
        after += static_cast<double>(out[y * kWidth + x].x);
      }
    }
    EXPECT_NEAR(after / before, 1.0, 0.02);
  }
}

/// As the variance goes to zero the filter must do nothing, or the guess would not converge.
TEST(Denoise, FadesWithTheVariance) {
  const Corner corner;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> detail(0.5f, 1.5f);
  std::vector<vec3> sharp;
  for (const vec3& t : corner.truth) sharp.push_back(t * detail(random));
  double last = 1e30;
  for (float v : {1e-2f, 1e-4f, 1e-6f, 0.0f}) {
    const auto out = denoiseGuess(corner.features, sharp, std::vector<vec3>(sharp.size(), vec3(v)));
    const double change = meanSquare(out, sharp);
    EXPECT_LT(change, last);
    last = change;
  }
  EXPECT_LT(last, 1e-10);
}

TEST(Denoise, IsDeterministicAndHandlesEmptyPixels) {
  FeatureImage nothing(kWidth, kHeight);
  std::vector<vec3> sky(kWidth * kHeight, vec3(0.7f)), variance(sky.size(), vec3(0.0f));
  sky[5] = vec3(1e8f);
  const auto out = denoiseGuess(nothing, sky, variance);
  for (const vec3& v : out) EXPECT_TRUE(isFinite(v));
  EXPECT_NEAR(out[100].x, 0.7f, 1e-5f);

  const Corner corner;
  const std::vector<vec3> one = denoiseGuess(corner.features, corner.truth, sky);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(denoiseGuess(corner.features, corner.truth, sky), one);
}

}  // namespace
}  // namespace trex
