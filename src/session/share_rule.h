// How many samples of each region are to be traced exactly as well: the rule of `--exact auto`,
// plain numbers from plain numbers. docs/auto.md tells it.
#pragma once

#include <span>
#include <vector>

namespace trex {

/// Mean square of the guess's bias that changes over some pixels and not over fewer: an estimate,
/// that may be negative, and its standard error.
struct BiasFigures {
  double square = 0.0, doubt = 0.0;
};

/// Standard errors of an estimate that count as noise.
inline constexpr double kSurely = 2.0;

/// What of an estimate stands out: nothing below kSurely standard errors, all far above.
inline double standsOut(const BiasFigures& f) {
  const double noise = kSurely * f.doubt;
  return f.square > noise ? f.square - noise * noise / f.square : 0.0;
}

/// Scales at which bias is told apart, pixels of a block each way, and how many pixels around one a
/// filter of differences takes the mean of at each, about.
inline constexpr int kScales = 2;
inline constexpr unsigned kBlockSides[kScales] = {8, 2};
inline constexpr double kPooledPairs[kScales] = {32.0, 4.0};
/// Likewise of guesses, whose detail limits the filter.
inline constexpr double kPooledGuesses = 16.0;

/// Pixels that a pixel's value is the mean of, about. Without a filter: itself alone.
struct Pooling {
  double guesses = kPooledGuesses;
  double pairs[kScales] = {kPooledPairs[0], kPooledPairs[1]};

  static constexpr Pooling none() { return {1.0, {1.0, 1.0}}; }
};

/// What is known of a region's samples. Variances and bias are relative: of values over
/// mean^2 + 0.01 (mean of the region)^2, as in relMSE.
struct ShareFigures {
  double pixels = 1.0;
  double pairs = 0.0;           ///< of a pixel, so far
  double guessCost = 1.0;       ///< rays of a guess, above 0
  double pairCost = 0.0;        ///< rays that its exact path adds
  double guessVariance = 0.0;   ///< of one guess
  double pairVariance = 0.0;    ///< of one difference between exact path and guess
  BiasFigures bias[kScales]{};  ///< of the guess, at each scale what coarser ones lack
  Pooling pooling{};            ///< by the picture's filter
};

/// Shares are never less: pairs grow without end, so pictures converge.
inline constexpr double kLeastShareOfPairs = 1.0 / 32.0;
/// Of the rays of guesses, what is spent in any case on bias that does not show yet: where exact
/// paths cost little more than guesses, that is many pairs.
inline constexpr double kPremium = 0.05;
/// Of the first samples, of which nothing is known.
inline constexpr double kFirstShare = 1.0 / 16.0;

/// The least share of a region: the larger one of both.
double leastShare(const ShareFigures& figures);

/// Error of a region with so many samples and pairs a pixel: the guess's noise, and what is left of
/// its bias when as much of the correction is added as stands out of the correction's noise.
double expectedError(const ShareFigures& figures, double samples, double pairs);

/// Draws each region's bias at each scale to the mean of all regions, less two standard errors, the
/// more the less of their differences stands out of the estimates' errors (empirical Bayes); to 0
/// where it is negative.
void poolBias(std::span<ShareFigures> regions);

/// Shares of the regions, leastShare() to 1, with which as many rays again as were spent so
/// far lower the mean of expectedError() most. Every pixel has `samples` >= 1 samples; bias and
/// variances not negative. Of a region whose bias stands out of all noise the share is, in the end,
/// that of multilevel estimation, proportional to sqrt(pairVariance / pairCost) [Giles 2008].
std::vector<double> chooseShares(std::span<const ShareFigures> regions, double samples);

}  // namespace trex
