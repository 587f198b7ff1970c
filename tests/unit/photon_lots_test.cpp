#include "src/crays/photon_lots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace trex {
namespace {

const Box3f kUnit{vec3(0.0f), vec3(1.0f)};
const vec3 kHere(0.1f), kThere(0.9f);

TEST(PhotonLots, OfNothingIsNothing) {
  EXPECT_EQ(PhotonLots().noise(kHere, 3), 0.0f);
  EXPECT_EQ(PhotonLots().before(kHere), 1.0f);
  LotSums none;
  none.add(kHere, 1, 1.0f);
  EXPECT_FALSE(none.counts());
  EXPECT_EQ(none.settle(100).noise(kHere, 0), 0.0f);
  LotSums sums(kUnit);
  EXPECT_EQ(sums.settle(0).before(kHere), 1.0f);
  EXPECT_EQ(sums.settle(5000).noise(kHere, 0), 0.0f);
}

TEST(PhotonLots, PixelsOfASquareOfTwoAskTheSame) {
  for (std::uint32_t y = 0; y < 8; ++y) {
    for (std::uint32_t x = 0; x < 16; ++x) {
      EXPECT_LT(PhotonLots::ofPixel(x, y), PhotonLots::kLots);
      EXPECT_EQ(PhotonLots::ofPixel(x, y), PhotonLots::ofPixel(x & ~1u, y & ~1u));
    }
  }
}

TEST(PhotonLots, LightBeforeIsThatOfTheMeanPhoton) {
  LotSums sums(kUnit);
  for (std::uint64_t i = 0; i < 1000; ++i) sums.add(kHere, i, 2.0f);
  EXPECT_EQ(sums.settle(1000).before(kHere), 1.0f);
  for (std::uint64_t i = 1000; i < 4000; ++i) sums.add(kHere, i, i % 2 == 0 ? 3.0f : 5.0f);
  const PhotonLots lots = sums.settle(4000);
  EXPECT_FLOAT_EQ(lots.before(kHere), 2.0f / (14000.0f / 4000.0f));
  EXPECT_EQ(lots.before(kThere), 1.0f);
  sums.restart();
  EXPECT_EQ(sums.settle(10).before(kHere), 1.0f);
}

/// The mean square of the lots' draws is the variance of the whole, whatever the number of photons.
TEST(PhotonLots, TellTheVarianceOfAll) {
  constexpr float kChance = 0.01f;
  constexpr int kTrials = 300;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  for (const std::uint64_t photons : {4096u, 5000u, 7000u}) {
    double told = 0.0, variance = 0.0, mean = 0.0;
    for (int trial = 0; trial < kTrials; ++trial) {
      LotSums sums(kUnit);
      double all = 0.0;
      for (std::uint64_t i = 0; i < photons; ++i) {
        const float power = unit(random) < kChance ? 1.0f : 0.0f;
        if (power > 0.0f) sums.add(kHere, i, power);
        all += static_cast<double>(power);
      }
      const double off = all / (static_cast<double>(kChance) * static_cast<double>(photons)) - 1.0;
      variance += off * off / kTrials;
      const PhotonLots lots = sums.settle(photons);
      for (std::uint32_t lot = 0; lot < PhotonLots::kLots; ++lot) {
        const auto noise = static_cast<double>(lots.noise(kHere, lot));
        told += noise * noise / (kTrials * PhotonLots::kLots);
        mean += noise / (kTrials * PhotonLots::kLots);
      }
    }
    EXPECT_NEAR(told / variance, 1.0, 0.25) << photons;
    EXPECT_NEAR(mean, 0.0, 0.02) << photons;
  }
}

}  // namespace
}  // namespace trex
