#include "src/frame/estimator.h"

#include <gtest/gtest.h>

#include <random>

namespace trex {
namespace {

TEST(Moments, MeanAndVarianceOfKnownNumbers) {
  Moments m;
  for (float x : {1.0f, 2.0f, 3.0f, 4.0f}) m.add(vec3(x, 2.0f * x, 0.0f));
  EXPECT_DOUBLE_EQ(m.mean().x, 2.5);
  EXPECT_DOUBLE_EQ(m.mean().y, 5.0);
  EXPECT_NEAR(m.varianceOfMean().x, (5.0 / 3.0) / 4.0, 1e-12);
  EXPECT_NEAR(m.varianceOfMean().y, 4.0 * (5.0 / 3.0) / 4.0, 1e-12);
  EXPECT_EQ(m.varianceOfMean().z, 0.0);
}

TEST(Moments, StaysExactForAMillionSamples) {
  Moments m;
  for (int i = 0; i < 1'000'000; ++i) m.add(vec3(0.1f, 1e8f, 1e-8f));
  EXPECT_NEAR(m.mean().x / static_cast<double>(0.1f), 1.0, 1e-9);
  EXPECT_NEAR(m.mean().y / 1e8, 1.0, 1e-9);
  EXPECT_NEAR(m.mean().z / static_cast<double>(1e-8f), 1.0, 1e-9);
  EXPECT_LT(m.varianceOfMean().y, 1.0);
}

TEST(TakesExact, TakesTheShareEvenly) {
  for (double share : {0.0, 0.05, 0.25, 0.5, 0.9, 1.0}) {
    for (double offset : {0.0, 0.37, 0.99}) {
      int taken = 0;
      for (std::uint64_t s = 0; s < 400; ++s) {
        taken += takesExact(s, share, offset);
        EXPECT_NEAR(taken, static_cast<double>(s + 1) * share, 1.0 + 1e-9);
      }
      EXPECT_NEAR(taken, 400 * share, 1.0);
    }
  }
}

TEST(TakesExact, FirstSampleIsChosenWithProbabilityOfTheShare) {
  int taken = 0;
  for (int i = 0; i < 1000; ++i) taken += takesExact(0, 0.3, i / 1000.0);
  EXPECT_NEAR(taken, 300, 1);
}

/// A biased guess that is strongly correlated with the truth: the combination has the truth as
/// mean, and the variance it reports is the one seen over many runs.
TEST(Difference, CorrectsABiasedGuessAndReportsItsVariance) {
  constexpr int kRuns = 2000, kSamples = 64;
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0f, 1.0f);
  double sum = 0.0, sum2 = 0.0, reported = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    Moments guess;
    DifferenceMoments pairs;
    for (std::uint64_t s = 0; s < kSamples; ++s) {
      const float truth = 3.0f + noise(random);
      const float biased = 0.7f * truth + 0.5f + 0.1f * noise(random);
      guess.add(vec3(biased));
      if (takesExact(s, 0.25, run / double{kRuns})) pairs.add(vec3(biased), vec3(truth));
    }
    const double mean = combinedMean(guess, pairs).x;
    sum += mean;
    sum2 += mean * mean;
    reported += combinedVariance(guess, pairs).x;
  }
  const double mean = sum / kRuns, variance = sum2 / kRuns - mean * mean;
  EXPECT_NEAR(mean, 3.0, 4.0 * std::sqrt(variance / kRuns));
  EXPECT_NEAR(reported / kRuns / variance, 1.0, 0.12);
}

TEST(Difference, AllPairsGiveTheExactMean) {
  Moments guess;
  DifferenceMoments pairs;
  double truth = 0.0;
  for (int i = 0; i < 100; ++i) {
    const float x = 0.25f * static_cast<float>(i % 7), g = static_cast<float>(i % 3);
    guess.add(vec3(g));
    pairs.add(vec3(g), vec3(x));
    truth += static_cast<double>(x) / 100.0;
  }
  EXPECT_NEAR(combinedMean(guess, pairs).x, truth, 1e-12);
}

}  // namespace
}  // namespace trex
