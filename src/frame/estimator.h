// The estimator of a pixel: a guess G for every sample, and for a share q of the samples also the
// exact value X, kept as the difference D = X - G. mean(G) + mean(D) has the expectation of X for
// every guess and every q > 0. Knows nothing of rays or devices.
//
// The common part of a sample (what guess and exact path share, such as direct light) belongs to G;
// it cancels in D.
#pragma once

#include <cmath>
#include <cstdint>

#include "src/core/maths.h"

namespace trex {

/// Count, sum and spread of RGB samples in double: after 10^6 samples the relative rounding error
/// of the mean is below 1e-9. Deterministic for one order of samples.
class Moments {
 public:
  void add(const vec3& value) {
    const double before = static_cast<double>(count_++);
    for (int c = 0; c < 3; ++c) {
      const double x = static_cast<double>(value[c]);
      // Welford's recurrence, with the means before and after this sample.
      const double delta = before > 0.0 ? x - sum_[c] / before : 0.0;
      sum_[c] += x;
      spread_[c] += delta * (x - sum_[c] / (before + 1.0));
    }
  }
  std::uint64_t count() const { return count_; }
  dvec3 mean() const {
    return count_ == 0 ? dvec3(0.0)
                       : dvec3(sum_[0], sum_[1], sum_[2]) / static_cast<double>(count_);
  }
  /// Unbiased variance of the mean; 0 below two samples.
  dvec3 varianceOfMean() const {
    if (count_ < 2) return dvec3(0.0);
    const double n = static_cast<double>(count_);
    return dvec3(spread_[0], spread_[1], spread_[2]) / (n * (n - 1.0));
  }
  /// Sum of the samples' squares.
  dvec3 squares() const {
    const dvec3 m = mean();
    return dvec3(spread_[0], spread_[1], spread_[2]) + m * m * static_cast<double>(count_);
  }

 private:
  std::uint64_t count_ = 0;
  double sum_[3] = {0.0, 0.0, 0.0}, spread_[3] = {0.0, 0.0, 0.0};
};

/// Sums of D = X - G over the paired samples, and how D varies together with G.
class DifferenceMoments {
 public:
  void add(const vec3& guess, const vec3& exact) {
    const vec3 difference = exact - guess;
    const double before = static_cast<double>(difference_.count());
    const dvec3 delta = before > 0.0 ? dvec3(difference) - difference_.mean() : dvec3(0.0);
    difference_.add(difference);
    guessSum_ += dvec3(guess);
    coSpread_ += delta * (dvec3(guess) - guessSum_ / (before + 1.0));
  }
  const Moments& difference() const { return difference_; }
  /// Covariance of one guess and its difference; 0 below two pairs.
  dvec3 covariance() const {
    const double n = static_cast<double>(difference_.count());
    return n < 2.0 ? dvec3(0.0) : coSpread_ / (n - 1.0);
  }

 private:
  Moments difference_;
  dvec3 guessSum_{0.0}, coSpread_{0.0};
};

// Checkpoints keep both as bytes: plain numbers without padding.
static_assert(sizeof(Moments) == 7 * 8 && sizeof(DifferenceMoments) == sizeof(Moments) + 6 * 8);

/// mean(G) + mean(D).
inline dvec3 combinedMean(const Moments& guess, const DifferenceMoments& pairs) {
  return guess.mean() + pairs.difference().mean();
}

/// Variance of combinedMean(). The pairs are a subset of the samples, so the covariance of the two
/// means is cov(G, D) / count(G).
inline dvec3 combinedVariance(const Moments& guess, const DifferenceMoments& pairs) {
  if (guess.count() == 0) return dvec3(0.0);
  const dvec3 together = 2.0 * pairs.covariance() / static_cast<double>(guess.count());
  return glm::max(guess.varianceOfMean() + pairs.difference().varianceOfMean() + together,
                  dvec3(0.0));
}

/// Whether sample number `sample` of a pixel also takes the exact path. Over any n consecutive
/// samples floor or ceil of n * share are taken; `offset` in [0, 1), a hash of the pixel, shifts
/// the pattern so that neighbours differ and the choice is unbiased. share in [0, 1].
inline bool takesExact(std::uint64_t sample, double share, double offset) {
  if (share >= 1.0) return true;
  if (share <= 0.0) return false;
  const double s = static_cast<double>(sample);
  return std::floor((s + 1.0) * share + offset) > std::floor(s * share + offset);
}

}  // namespace trex
