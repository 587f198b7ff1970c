#include "src/frame/denoise.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <random>
#include <utility>

#include "tests/unit/scalar_filter.h"

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
  /// The same walls, with one sample of that light a pixel.
  FeatureImage lit(const std::vector<vec3>& light) const {
    FeatureImage out(kWidth, kHeight);
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x)
        out.add(x, y, features.mean(x, y), light[y * kWidth + x]);
    }
    return out;
  }
};

/// The filtered guess of the light that features hold.
std::vector<vec3> ofSamples(const FeatureImage& features, bool few) {
  GuessFilter filter(features, few);
  filter.advance([] { return true; });
  return filter.result();
}

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

/// Single samples a hundred times as bright as what is around them, which the weights of the filter
/// take for something else.
TEST(Denoise, GivesBackTheLightOfRareSamples) {
  const Corner corner;
  std::vector<vec3> dotted = corner.truth;
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (vec3& v : dotted) {
    if (unit(random) < 0.01f) v *= 100.0f;
  }
  const std::vector<vec3> little(dotted.size(), vec3(1e-3f));
  const std::vector<vec3> spread = ofSamples(corner.lit(dotted), true);
  for (const auto& out : {denoiseGuess(corner.features, dotted, little), spread}) {
    for (std::uint32_t from : {0u, kWidth / 2}) {
      double before = 0.0, after = 0.0;
      for (std::uint32_t y = 0; y < kHeight; ++y) {
        for (std::uint32_t x = from; x < from + kWidth / 2; ++x) {
          before += static_cast<double>(dotted[y * kWidth + x].x);
          after += static_cast<double>(out[y * kWidth + x].x);
        }
      }
      EXPECT_NEAR(after / before, 1.0, 1e-3);
    }
    for (const vec3& v : out) EXPECT_GE(v.x, 0.0f);
  }
  const auto brightest = [](const std::vector<vec3>& picture) {
    float most = 0.0f;
    for (const vec3& v : picture) most = std::max(most, v.x);
    return most;
  };
  EXPECT_LT(brightest(spread), 0.15f * brightest(dotted));
}

TEST(Denoise, LeavesAnEvenPictureEven) {
  const Corner corner;
  const std::vector<vec3> noise(corner.truth.size(), vec3(1.0f));
  const auto out = denoiseGuess(corner.features, corner.truth, noise);
  for (std::size_t i = 0; i < out.size(); ++i) EXPECT_NEAR(out[i].x, corner.truth[i].x, 1e-4f);
}

/// What reflects nothing keeps its light, and no light of the surface around it reaches it.
TEST(Denoise, KeepsUnlitSurfacesApart) {
  FeatureImage features(kWidth, kHeight);
  std::vector<vec3> light;
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      const float unlit = x / 8 % 2 ? 1.0f : 0.0f;
      const vec3 position(0.1f * static_cast<float>(x), 0.1f * static_cast<float>(y), 0.0f);
      features.add(x, y, {vec3(0.1f * (1.0f - unlit)), vec3(0, 0, 1), position, 0.1f, unlit});
      light.emplace_back(1.0f - unlit);
    }
  }
  const auto out = denoiseGuess(features, light, std::vector<vec3>(light.size(), vec3(1.0f)));
  for (std::size_t i = 0; i < out.size(); ++i) EXPECT_NEAR(out[i].x, light[i].x, 1e-4f);
}

/// A disk of one brightness before a ground of another, further back: samples at random places of
/// each pixel, as many of them on either as its rim leaves, and noise on all of them.
struct Disk {
  static constexpr int kSamples = 16;
  FeatureImage features{kWidth, kHeight};
  std::vector<vec3> raw, truth;  ///< of the same samples with and without noise
  std::vector<bool> rim;

  Disk(float ofDisk, float ofGround, float noise) {
    std::mt19937 random(11);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::exponential_distribution<float> rare(1.0f);
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      for (std::uint32_t x = 0; x < kWidth; ++x) {
        vec3 sum(0.0f), noiseless(0.0f);
        int inside = 0;
        for (int i = 0; i < kSamples; ++i) {
          const float px = static_cast<float>(x) + unit(random),
                      py = static_cast<float>(y) + unit(random);
          const bool disk = glm::length(vec2(px - 24.0f, py - 16.0f)) < 10.3f;
          const vec3 light(disk ? ofDisk : ofGround);
          const vec3 sample = light * (1.0f - noise + noise * rare(random));
          const vec3 position(0.1f * px, 0.1f * py, disk ? 3.0f : 0.0f);
          features.add(x, y, {vec3(0.5f), vec3(0, 0, 1), position, 0.1f}, sample);
          sum += sample;
          noiseless += light;
          inside += disk ? 1 : 0;
        }
        raw.push_back(sum / static_cast<float>(kSamples));
        truth.push_back(noiseless / static_cast<float>(kSamples));
        rim.push_back(inside > 0 && inside < kSamples);
      }
    }
  }
  /// Root of the mean square of what the rim's pixels are off by, and the mean.
  std::pair<double, double> errorOfRim(const std::vector<vec3>& picture) const {
    double square = 0.0, sum = 0.0, count = 0.0;
    for (std::size_t i = 0; i < picture.size(); ++i) {
      if (!rim[i]) continue;
      const auto off = static_cast<double>(picture[i].x - truth[i].x);
      square += off * off;
      sum += off;
      count += 1.0;
    }
    return {std::sqrt(square / count), sum / count};
  }
};

/// Rims are the mean of what they part: as sharp as the samples say, and free of dots.
TEST(Denoise, RimsLoseTheirNoiseAndStaySharp) {
  for (const auto& [ofDisk, ofGround] : {std::pair(5.0f, 0.1f), std::pair(0.1f, 5.0f)}) {
    const Disk disk(ofDisk, ofGround, 1.0f);
    const auto out = ofSamples(disk.features, false);
    const auto [noise, rawMean] = disk.errorOfRim(disk.raw);
    const auto [error, mean] = disk.errorOfRim(out);
    EXPECT_LT(error, 0.5 * noise) << ofDisk;
    EXPECT_LT(std::abs(mean), 0.15 * noise) << ofDisk;
    double before = 0.0, after = 0.0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      before += static_cast<double>(disk.raw[i].x);
      after += static_cast<double>(out[i].x);
    }
    EXPECT_NEAR(after / before, 1.0, 1e-3) << ofDisk;
    // Without noise nothing is to be done.
    const Disk still(ofDisk, ofGround, 0.0f);
    EXPECT_LT(still.errorOfRim(ofSamples(still.features, false)).first, 1e-3);
  }
}

/// Glass that mirrors one wall and lets another be seen, in every pixel: none of them has
/// neighbours that show less than both.
TEST(Denoise, GlassIsFilteredAsTheTwoThingsItShows) {
  FeatureImage features(kWidth, kHeight);
  std::vector<vec3> raw;
  std::mt19937 random(13);
  std::exponential_distribution<float> rare(1.0f);
  double before = 0.0, after = 0.0, noise = 0.0, error = 0.0;
  for (std::uint32_t y = 0; y < kHeight; ++y) {
    for (std::uint32_t x = 0; x < kWidth; ++x) {
      vec3 sum(0.0f);
      for (int i = 0; i < 16; ++i) {
        const bool mirrored = i % 4 == 3;
        const vec3 sample((mirrored ? 8.0f : 1.0f) * rare(random));
        const vec3 position(0.1f * static_cast<float>(x), 0.1f * static_cast<float>(y),
                            mirrored ? -4.0f : 3.0f);
        features.add(x, y, {vec3(mirrored ? 0.9f : 0.4f), vec3(0, 0, 1), position, 0.1f}, sample);
        sum += sample;
      }
      raw.push_back(sum / 16.0f);
    }
  }
  const auto out = ofSamples(features, false);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double truth = 0.75 + 0.25 * 8.0;
    before += static_cast<double>(raw[i].x);
    after += static_cast<double>(out[i].x);
    noise += std::pow(static_cast<double>(raw[i].x) - truth, 2.0);
    error += std::pow(static_cast<double>(out[i].x) - truth, 2.0);
  }
  EXPECT_NEAR(after / before, 1.0, 1e-3);
  EXPECT_LT(error, 0.2 * noise);
}

TEST(Features, KeepTheSurfacesOfAPixelApart) {
  FeatureImage features(1, 1);
  const Feature wall{vec3(0.8f), vec3(0, 0, 1), vec3(0.0f), 0.1f},
      floor{vec3(0.2f), vec3(0, 1, 0), vec3(0.0f, -1.0f, 0.0f), 0.1f};
  features.add(0, 0, wall, vec3(1.0f));
  features.add(0, 0, floor, vec3(4.0f));
  features.add(0, 0, floor, vec3(6.0f));
  EXPECT_EQ(features.most(0, 0).mean.normal, vec3(0, 1, 0));
  EXPECT_EQ(features.most(0, 0).light, vec3(5.0f));
  EXPECT_EQ(features.most(0, 0).variance(), vec3(1.0f));  // of 4 and 6: 2, of their mean: 1
  EXPECT_EQ(features.rest(0, 0).light, vec3(1.0f));
  EXPECT_NEAR(features.shareOfMost(0, 0), 2.0f / 3.0f, 1e-6f);
  EXPECT_NEAR(features.mean(0, 0).albedo.x, 0.4f, 1e-6f);
  EXPECT_NEAR(features.light(0, 0).x, 11.0f / 3.0f, 1e-6f);
  EXPECT_EQ(features.scattering(0, 0), 1.0f);
  features.restart(0, 0);
  features.add(0, 0, {}, vec3(0.0f));
  features.add(0, 0, {}, vec3(0.0f));
  features.add(0, 0, wall, vec3(1.0f));
  EXPECT_NEAR(features.scattering(0, 0), 1.0f / 3.0f, 1e-6f);
  EXPECT_EQ(features.surface(0, 0).mean.normal, wall.normal);
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

struct Input {
  FeatureImage features;
  std::vector<vec3> radiance, variance;
};

/// Everything a picture may show, pixel by pixel at random: few surfaces, rims where two of them
/// meet in a mean, places without any, pixels with no variance.
Input mixed(std::uint32_t width, std::uint32_t height) {
  Input in{FeatureImage(width, height), {}, {}};
  std::mt19937 random(width * 131 + height);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      const int samples = unit(random) < 0.2f ? 2 : 1;
      for (int i = 0; i < samples; ++i) {
        Feature f;
        const float kind = unit(random);
        if (kind > 0.1f) {
          f.normal = kind > 0.9f ? vec3(1, 0, 0) : glm::normalize(vec3(0.1f * unit(random), 0, 1));
          f.albedo = vec3(kind < 0.3f ? 0.0f : 0.6f + 0.05f * unit(random));
          f.position = vec3(0.1f * static_cast<float>(x), 0.1f * static_cast<float>(y),
                            0.05f * unit(random));
          f.footprint = kind < 0.12f ? 0.0f : 0.1f;
        }
        in.features.add(x, y, f);
      }
      in.radiance.emplace_back(unit(random), unit(random), unit(random));
      in.variance.push_back(vec3(unit(random) < 0.2f ? 0.0f : unit(random)));
    }
  }
  return in;
}

constexpr glm::uvec2 kSizes[] = {{1, 1}, {1, 70}, {3, 2}, {7, 5}, {641, 3}, {90, 75}};

std::vector<vec3> filtered(const Input& in, bool correction) {
  return (correction ? denoiseCorrection : denoiseGuess)(in.features, in.radiance, in.variance);
}

bool sameBits(const std::vector<vec3>& a, const std::vector<vec3>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(vec3)) == 0;
}

TEST(Denoise, IsThatOfThePlainFilter) {
  for (const glm::uvec2& size : kSizes) {
    const Input in = mixed(size.x, size.y);
    for (const bool correction : {false, true}) {
      const auto got = filtered(in, correction);
      const auto expected =
          test::ScalarFilter(in.features, in.radiance, in.variance).run(correction);
      ASSERT_EQ(got.size(), expected.size());
      for (std::size_t i = 0; i < got.size(); ++i) {
        for (int c = 0; c < 3; ++c) {
          // What is given back may be negative and leave little of a pixel's light.
          const float largest = std::max(std::abs(expected[i][c]), in.radiance[i][c]);
          ASSERT_NEAR(got[i][c], expected[i][c], 1e-5f * largest)
              << "pixel " << i << " of " << size.x << "x" << size.y;
        }
      }
    }
  }
}

TEST(Denoise, HasTheSameBitsOnEveryInstructionSetAndAnyNumberOfThreads) {
  for (const glm::uvec2& size : kSizes) {
    const Input in = mixed(size.x, size.y);
    const std::vector<vec3> expected = filtered(in, true);
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      EXPECT_TRUE(sameBits(filtered(in, true), expected))
          << hwy::TargetName(target) << " at " << size.x << "x" << size.y;
    }
    hwy::SetSupportedTargetsForTest(0);
    for (const std::size_t threads : {1u, 2u, 5u}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      EXPECT_TRUE(sameBits(filtered(in, true), expected)) << threads << " threads";
    }
  }
}

TEST(Denoise, RimsHaveTheSameBitsOnEveryInstructionSetAndAnyNumberOfThreads) {
  const Disk disk(5.0f, 0.1f, 1.0f);
  for (const bool few : {false, true}) {
    const std::vector<vec3> expected = ofSamples(disk.features, few);
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      EXPECT_TRUE(sameBits(ofSamples(disk.features, few), expected)) << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
    for (const std::size_t threads : {1u, 5u}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      EXPECT_TRUE(sameBits(ofSamples(disk.features, few), expected)) << threads << " threads";
    }
  }
}

TEST(Denoise, GivesTheSameBitsInSlices) {
  const Input in = mixed(301, 203);
  const std::vector<vec3> expected = filtered(in, false);
  for (const int most : {1, 2, 3}) {
    GuessFilter filter(in.features, in.radiance, in.variance, false);
    int slices = 1;
    for (int bands = 0; !filter.advance([&] { return ++bands < most; }); bands = 0) ++slices;
    EXPECT_GE(slices, 20 / most);  // 20 passes over the picture
    EXPECT_TRUE(filter.advance([] { return false; })) << "done once and for all";
    EXPECT_TRUE(sameBits(filter.result(), expected)) << most << " bands a slice";
  }
}

TEST(Denoise, KeepsItsOwnCopyOfTheInput) {
  Input in = mixed(64, 48);
  const std::vector<vec3> expected = filtered(in, false);
  GuessFilter first(in.features, in.radiance, in.variance, false);
  in = mixed(1, 1);
  GuessFilter moved = std::move(first);
  while (!moved.advance([] { return false; })) {
  }
  EXPECT_TRUE(sameBits(moved.result(), expected));
}

TEST(Denoise, LeavesAPictureWithoutVarianceAsItIs) {
  for (const glm::uvec2& size : kSizes) {
    Input in = mixed(size.x, size.y);
    in.variance.assign(in.variance.size(), vec3(0.0f));
    for (const bool correction : {false, true}) {
      const auto out = filtered(in, correction);
      for (std::size_t i = 0; i < out.size(); ++i) {
        EXPECT_NEAR(glm::length(out[i] - in.radiance[i]), 0.0f, 1e-5f);
      }
    }
  }
}

TEST(Denoise, StaysFiniteWhateverTheLight) {
  for (const glm::uvec2& size : kSizes) {
    Input in = mixed(size.x, size.y);
    for (std::size_t i = 0; i < in.radiance.size(); ++i) {
      if (i % 3 == 0) in.radiance[i] = vec3(1e8f);
      if (i % 2 == 0) in.variance[i] = vec3(1e30f);
    }
    for (const bool correction : {false, true}) {
      for (const vec3& v : filtered(in, correction)) ASSERT_TRUE(isFinite(v));
    }
  }
}

}  // namespace
}  // namespace trex
