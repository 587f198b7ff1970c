#include "src/core/sampler.h"

#include <gtest/gtest.h>

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

TEST(Sampler, SecondSobolDimensionMatchesItsRecurrence) {
  // Direction numbers v_0 = 2^31, v_{k+1} = v_k xor (v_k >> 1) [Sobol' 1967].
  for (std::uint32_t index : {1u, 2u, 3u, 77u, 0x12345678u, 0xffffffffu}) {
    std::uint32_t expected = 0, v = 0x80000000u;
    for (std::uint32_t i = index; i != 0; i >>= 1, v ^= v >> 1) {
      if (i & 1u) expected ^= v;
    }
    EXPECT_EQ(reverseBits(sobolSecond(index)), expected);
  }
}

}  // namespace
}  // namespace trex
