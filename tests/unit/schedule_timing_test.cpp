// The timing model: parameters found again, extremes, outliers, jobs that it was not fitted to.
#include "src/schedule/timing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "src/core/error.h"

namespace trex::schedule {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

TEST(ScheduleTiming, EmptyWorkTakesNoTime) {
  const LinearTime t{0.5, {2.0, 3.0}};
  EXPECT_EQ(t.seconds(std::vector<double>{}), 0.0);
  EXPECT_EQ(t.seconds(std::vector<double>{0.0, 0.0}), 0.0);
  EXPECT_DOUBLE_EQ(t.seconds(std::vector<double>{1.0, 0.0}), 2.5);
  EXPECT_DOUBLE_EQ(t.seconds(std::vector<double>{1.0, 2.0}), 8.5);
}

TEST(ScheduleTiming, FitRecoversParameters) {
  const LinearTime truth{2e-3, {1e-7, 5e-6}};
  std::mt19937 random(1);
  std::uniform_real_distribution<double> u(0.0, 1.0);
  std::vector<TimingSample> samples;
  for (int i = 0; i < 40; ++i) {
    std::vector<double> w{1e6 * u(random), 1e4 * u(random)};
    samples.push_back({w, truth.seconds(w)});
  }
  LinearTime fitted = fitLinear(samples);
  EXPECT_NEAR(fitted.setup / truth.setup, 1.0, 1e-3);
  EXPECT_NEAR(fitted.rates[0] / truth.rates[0], 1.0, 1e-3);
  EXPECT_NEAR(fitted.rates[1] / truth.rates[1], 1.0, 1e-3);
  // A tenth of the jobs took ten times as long: they do not count for more than the others.
  for (std::size_t i = 0; i < samples.size(); i += 10) samples[i].seconds *= 10.0;
  fitted = fitLinear(samples);
  EXPECT_NEAR(fitted.rates[0] / truth.rates[0], 1.0, 0.05);
  EXPECT_NEAR(fitted.rates[1] / truth.rates[1], 1.0, 0.05);
}

TEST(ScheduleTiming, FewSamples) {
  // One sample: all of it is rate.
  const LinearTime one = fitLinear(std::vector<TimingSample>{{{100.0}, 1.0}});
  EXPECT_NEAR(one.rates[0], 0.01, 1e-3);
  EXPECT_NEAR(one.seconds(std::vector<double>{100.0}), 1.0, 1e-4);
  // An amount that never occurs has no rate; nothing but setup is setup.
  const LinearTime never =
      fitLinear(std::vector<TimingSample>{{{10.0, 0.0}, 1.0}, {{20.0, 0.0}, 2.0}});
  EXPECT_EQ(never.rates[1], 0.0);
  EXPECT_NEAR(never.rates[0], 0.1, 1e-3);
  const LinearTime setup = fitLinear(std::vector<TimingSample>{{{0.0}, 3.0}, {{0.0}, 3.0}});
  EXPECT_NEAR(setup.setup, 3.0, 1e-3);
}

TEST(ScheduleTiming, CollinearAmountsShareTheRate) {
  std::vector<TimingSample> samples;
  for (double w : {1.0, 2.0, 5.0, 9.0}) samples.push_back({{w, w}, 4.0 * w});
  const LinearTime t = fitLinear(samples);
  EXPECT_NEAR(t.rates[0], 2.0, 0.01);
  EXPECT_NEAR(t.rates[1], 2.0, 0.01);
}

TEST(ScheduleTiming, NothingBelowZero) {
  // Larger jobs that were faster: plain least squares would have a falling rate.
  const LinearTime falling = fitLinear(std::vector<TimingSample>{{{1.0}, 2.0}, {{10.0}, 1.0}});
  EXPECT_GE(falling.rates[0], 0.0);
  EXPECT_GE(falling.setup, 0.0);
  // A setup below zero.
  const LinearTime below =
      fitLinear(std::vector<TimingSample>{{{1.0}, 0.5}, {{2.0}, 2.0}, {{3.0}, 3.5}});
  EXPECT_GE(below.setup, 0.0);
  EXPECT_GT(below.rates[0], 0.5);
}

TEST(ScheduleTiming, ManyMagnitudes) {
  std::vector<TimingSample> samples;
  for (double w = 1.0; w < 1e12; w *= 10.0) samples.push_back({{w}, 1e-6 + 1e-12 * w});
  const LinearTime t = fitLinear(samples);
  EXPECT_NEAR(t.setup / 1e-6, 1.0, 1e-2);
  EXPECT_NEAR(t.rates[0] / 1e-12, 1.0, 1e-2);
}

TEST(ScheduleTiming, RefusesWhatIsNoMeasurement) {
  EXPECT_THROW(fitLinear({}), Error);
  for (double bad : {0.0, -1.0, kInf, std::nan("")}) {
    EXPECT_THROW(fitLinear(std::vector<TimingSample>{{{1.0}, bad}}), Error);
  }
  for (double bad : {-1.0, kInf, std::nan("")}) {
    EXPECT_THROW(fitLinear(std::vector<TimingSample>{{{bad}, 1.0}}), Error);
    TimingModel model(1, 1);
    EXPECT_THROW(model.set(0, 0, {0.0, {bad}}), Error);
    EXPECT_THROW(model.set(0, 0, {bad, {}}), Error);
  }
  EXPECT_THROW(fitLinear(std::vector<TimingSample>{{{1.0}, 1.0}, {{1.0, 2.0}, 1.0}}), Error);
}

/// Jobs of all sizes whose times vary by a fifth, one in fifty taking three times as long.
std::vector<TimingSample> noisyJobs(std::uint32_t seed, int count) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(0.0, 1.0);
  std::normal_distribution<double> normal(0.0, 0.15);
  std::vector<TimingSample> samples;
  for (int i = 0; i < count; ++i) {
    const std::vector<double> w{std::pow(10.0, 3.0 + 4.0 * u(random))};
    double seconds = (1e-3 + 1.2e-7 * w[0]) * std::exp(normal(random));
    if (u(random) < 0.02) seconds *= 3.0;
    samples.push_back({w, seconds});
  }
  return samples;
}

TEST(ScheduleTiming, TellsJobsItWasNotFittedTo) {
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    const LinearTime t = fitLinear(noisyJobs(seed, 30));
    std::vector<double> errors;
    for (const TimingSample& s : noisyJobs(1000 + seed, 500)) {
      errors.push_back(std::abs(t.seconds(s.amounts) - s.seconds) / s.seconds);
    }
    std::sort(errors.begin(), errors.end());
    EXPECT_LE(errors[250], 0.15) << seed;
    EXPECT_LE(errors[450], 0.35) << seed;
  }
}

}  // namespace
}  // namespace trex::schedule
