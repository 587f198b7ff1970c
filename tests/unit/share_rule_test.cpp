// The rule by which the dial chooses shares: plain numbers from plain numbers.
#include "src/session/share_rule.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace trex {
namespace {

ShareFigures figures(double bias, double guessVariance = 1.0, double pairVariance = 4.0,
                     double pairCost = 2.0) {
  return {.pixels = 4096.0,
          .pairs = 1.0,
          .guessCost = 2.0,
          .pairCost = pairCost,
          .guessVariance = guessVariance,
          .pairVariance = pairVariance,
          .bias = {{bias, 0.0}, {}}};
}

TEST(ShareRule, ErrorHasItsLimits) {
  const ShareFigures f = figures(0.01);
  EXPECT_DOUBLE_EQ(expectedError(f, 1e12, 0.0), 0.01 + 1.0 / (kPooledGuesses * 1e12));
  EXPECT_NEAR(expectedError(f, 1e12, 1e6), 4.0 / (kPooledPairs[0] * 1e6), 1e-10);
  EXPECT_DOUBLE_EQ(expectedError(figures(0.0), 8.0, 3.0), 1.0 / (kPooledGuesses * 8.0));
}

TEST(ShareRule, WithoutBiasPairsAreFew) {
  for (const double samples : {2.0, 64.0, 4096.0}) {
    EXPECT_DOUBLE_EQ(chooseShares(std::vector{figures(0.0, 1.0, 4.0, 10.0)}, samples)[0],
                     kLeastShareOfPairs);
  }
}

TEST(ShareRule, BiasThatDoesNotShowYetGetsASmallPartOfTheRays) {
  for (const double cost : {0.01, 0.1, 1.0}) {
    const double share = chooseShares(std::vector{figures(0.0, 1.0, 4.0, cost)}, 16.0)[0];
    EXPECT_DOUBLE_EQ(share, std::min(kPremium * 2.0 / cost, 1.0));
  }
}

TEST(ShareRule, PairsThatCostNothingAreTaken) {
  EXPECT_DOUBLE_EQ(chooseShares(std::vector{figures(0.0, 1.0, 4.0, 0.0)}, 16.0)[0], 1.0);
}

TEST(ShareRule, WithoutAFilterPairsWaitUntilTheyAreWorthIt) {
  ShareFigures filtered = figures(0.02, 1.0, 4.0), alone = filtered;
  alone.pooling = Pooling::none();
  EXPECT_GT(chooseShares(std::vector{filtered}, 4.0)[0], 2.0 * leastShare(filtered));
  EXPECT_DOUBLE_EQ(chooseShares(std::vector{alone}, 4.0)[0], leastShare(alone));
  EXPECT_GT(chooseShares(std::vector{alone}, 1e5)[0], 2.0 * leastShare(alone));
}

/// Samples and pairs after many looks, each of which doubles the rays that are spent.
std::vector<ShareFigures> after(std::vector<ShareFigures> regions, int looks, double& samples) {
  for (int i = 0; i < looks; ++i) {
    const std::vector<double> shares = chooseShares(regions, samples);
    for (std::size_t k = 0; k < regions.size(); ++k) regions[k].pairs += shares[k] * samples;
    samples *= 2.0;
  }
  return regions;
}

TEST(ShareRule, FarBeyondTheBiasItIsThatOfMultilevelEstimation) {
  for (const double pairVariance : {0.05, 0.4, 2.0}) {
    double samples = 16.0;
    const auto end = after({figures(1e6, 1.0, pairVariance)}, 24, samples);
    const double best = std::sqrt(pairVariance / kPooledPairs[0] * kPooledGuesses * 2.0 / 2.0);
    EXPECT_NEAR(end[0].pairs / samples / best, 1.0, 0.1) << pairVariance;
  }
}

TEST(ShareRule, RegionsShareByTheRootOfVarianceOverCost) {
  double samples = 16.0;
  const auto end =
      after({figures(1e6, 1.0, 0.1, 1.0), figures(1e6, 1.0, 0.4, 4.0), figures(1e6, 1.0, 0.4, 1.0)},
            24, samples);
  EXPECT_NEAR(end[1].pairs / end[0].pairs, 1.0, 0.05);
  EXPECT_NEAR(end[2].pairs / end[0].pairs, 2.0, 0.1);
}

/// No other pair of shares, spending the same rays, has less error.
TEST(ShareRule, NoOtherSharesAreBetter) {
  const std::vector<ShareFigures> regions{figures(0.02, 1.0, 1.0), figures(0.001, 2.0, 8.0, 5.0)};
  constexpr double kSamples = 64.0;
  double spent = 0.0;
  for (const ShareFigures& f : regions) {
    spent += f.pixels * (kSamples * f.guessCost + f.pairs * f.pairCost);
  }
  const auto errorOf = [&](const std::vector<double>& shares) {
    double rays = 0.0, error = 0.0;
    for (std::size_t i = 0; i < 2; ++i) {
      rays += regions[i].pixels * (regions[i].guessCost + shares[i] * regions[i].pairCost);
    }
    const double more = spent / rays;
    for (std::size_t i = 0; i < 2; ++i) {
      error += expectedError(regions[i], kSamples + more, regions[i].pairs + shares[i] * more);
    }
    return error;
  };
  const double chosen = errorOf(chooseShares(regions, kSamples));
  for (int a = 0; a <= 20; ++a) {
    for (int b = 0; b <= 20; ++b) {
      const auto share = [](int i) {
        return kLeastShareOfPairs * std::pow(1.0 / kLeastShareOfPairs, i / 20.0);
      };
      EXPECT_LE(chosen, 1.02 * errorOf({share(a), share(b)})) << a << ' ' << b;
    }
  }
}

TEST(ShareRule, SharesStayInTheirRange) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> exponent(-12.0, 12.0);
  for (int i = 0; i < 200; ++i) {
    std::vector<ShareFigures> regions;
    for (int k = 0; k < 5; ++k) {
      const auto any = [&] { return std::pow(10.0, exponent(random)); };
      regions.push_back({.pixels = 64.0,
                         .pairs = any(),
                         .guessCost = 1.0 + any(),
                         .pairCost = any(),
                         .guessVariance = any(),
                         .pairVariance = any(),
                         .bias = {{any(), 0.0}, {any(), 0.0}}});
    }
    for (const double share : chooseShares(regions, 8.0)) {
      EXPECT_GE(share, kLeastShareOfPairs);
      EXPECT_LE(share, 1.0);
    }
  }
}

TEST(PoolBias, WithoutDoubtNothingIsPooled) {
  std::vector<ShareFigures> regions{figures(0.1), figures(0.4)};
  poolBias(regions);
  EXPECT_DOUBLE_EQ(regions[0].bias[0].square, 0.1);
  EXPECT_DOUBLE_EQ(regions[1].bias[0].square, 0.4);
}

TEST(PoolBias, WhatMayBeNoiseIsTheMeanLessItsError) {
  std::vector<ShareFigures> regions(4, figures(0.0));
  const double found[] = {0.3, -0.1, 0.2, 0.0};
  for (std::size_t i = 0; i < 4; ++i) {
    regions[i].bias[0] = {found[i], 0.2};
  }
  poolBias(regions);
  for (const ShareFigures& f : regions) EXPECT_NEAR(f.bias[0].square, 0.0, 1e-12);  // 0.1 - 0.2
  for (ShareFigures& f : regions) f.bias[0].square = 0.5;
  poolBias(regions);
  for (const ShareFigures& f : regions) EXPECT_NEAR(f.bias[0].square, 0.3, 1e-12);
}

}  // namespace
}  // namespace trex
