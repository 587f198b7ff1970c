#include "src/core/sampler.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <set>
#include <vector>

#include "tests/unit/chi_square.h"

namespace trex {
namespace {

TEST(Sampler, DependsOnPixelSampleDimensionAndSeedAlone) {
  Sampler a(7, 3, 1), b(7, 3, 1);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(a.next1D(), b.next1D());
  Sampler c(7, 3, 2), d(8, 3, 1), e(7, 4, 1), f(7, 3, 1);
  const float first = f.next1D();
  EXPECT_NE(first, c.next1D());
  EXPECT_NE(first, d.next1D());
  EXPECT_NE(first, e.next1D());
  EXPECT_NE(first, f.next1D());
}

TEST(Sampler, StaysInTheUnitInterval) {
  EXPECT_LT(toUnitFloat(0xffffffffu), 1.0f);
  EXPECT_EQ(toUnitFloat(0u), 0.0f);
}

/// 2^k samples of one pixel put exactly one into each of 2^k strata of either axis, and of the
/// square.
TEST(Sampler, IsStratifiedOverTheSamplesOfAPixel) {
  constexpr std::uint32_t kSamples = 256;
  for (std::uint32_t pixel : {0u, 1u, 12345u}) {
    for (std::uint32_t dimension : {0u, 1u, 9u}) {
      std::set<int> x, y, square;
      for (std::uint32_t s = 0; s < kSamples; ++s) {
        Sampler sampler(pixel, s, 0);
        sampler.setDimension(dimension);
        const vec2 u = sampler.next2D();
        x.insert(static_cast<int>(u.x * kSamples));
        y.insert(static_cast<int>(u.y * kSamples));
        square.insert(static_cast<int>(u.x * 16.0f) * 16 + static_cast<int>(u.y * 16.0f));
      }
      EXPECT_EQ(x.size(), kSamples);
      EXPECT_EQ(y.size(), kSamples);
      EXPECT_EQ(square.size(), kSamples);
    }
  }
}

/// Across pixels (one sample each) the points are independent: pairs of dimensions fill a grid
/// evenly.
TEST(Sampler, IsUniformAcrossPixelsAndDimensions) {
  constexpr int kGrid = 16, kCount = 200000;
  std::vector<double> counts(kGrid * kGrid, 0.0), across(kGrid * kGrid, 0.0);
  for (std::uint32_t pixel = 0; pixel < kCount; ++pixel) {
    Sampler sampler(pixel, 5, 0);
    const vec2 u = sampler.next2D();
    const float v = sampler.next1D();
    const auto cell = [&](float a, float b) {
      return static_cast<std::size_t>(a * kGrid) * kGrid + static_cast<std::size_t>(b * kGrid);
    };
    counts[cell(u.x, u.y)] += 1.0;
    across[cell(u.x, v)] += 1.0;
  }
  const std::vector<double> expected(counts.size(), double{kCount} / (kGrid * kGrid));
  EXPECT_GT(test::chiSquareP(counts, expected), 1e-4);
  EXPECT_GT(test::chiSquareP(across, expected), 1e-4);
}

/// Owen scrambling as it is written for one number.
std::uint32_t owenScramble(std::uint32_t x, std::uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverseBits(x);
}

/// By direction numbers v_0 = 2^31, v_{k+1} = v_k xor (v_k >> 1) [Sobol' 1967].
std::uint32_t sobolSecond(std::uint32_t index) {
  std::uint32_t x = 0, v = 0x80000000u;
  for (; index != 0; index >>= 1, v ^= v >> 1) {
    if (index & 1u) x ^= v;
  }
  return x;
}

vec2 expectedAt(std::uint32_t pixel, std::uint32_t sample, std::uint32_t seed,
                std::uint32_t dimension) {
  const std::uint32_t key =
      hashCombine(hashCombine(hashCombine(seed, 0x7265782du), pixel), dimension);
  const std::uint32_t index = owenScramble(reverseBits(sample), key);
  return {toUnitFloat(owenScramble(index, hash32(key ^ 0x5bd1e995u))),
          toUnitFloat(owenScramble(reverseBits(sobolSecond(index)), hash32(key ^ 0xc2b2ae35u)))};
}

/// Whatever the processor draws at once, and in whatever order dimensions are asked for.
TEST(Sampler, DrawsSobolPointsScrambledByDimension) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    for (const std::uint32_t pixel : {0u, 9u, 0xffffffffu}) {
      Sampler sampler(pixel, 77u, 5u);
      for (const std::uint32_t dimension : {0u, 1u, 2u, 7u, 8u, 20u, 19u, 3u, 4u, 1000u, 0u}) {
        sampler.setDimension(dimension);
        const vec2 expected = expectedAt(pixel, 77u, 5u, dimension);
        Sampler other(sampler.state());
        EXPECT_EQ(sampler.next2D(), expected) << dimension;
        EXPECT_EQ(other.next1D(), expected.x) << dimension;
        EXPECT_EQ(sampler.next2D(), expectedAt(pixel, 77u, 5u, dimension + 1)) << dimension;
      }
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
}

}  // namespace
}  // namespace trex
