#include "src/session/share_rule.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

/// Pairs a pixel of a region, at most and at least, once there are `more` samples.
double pairsAt(const ShareFigures& f, double reach, double more) {
  const double least = f.pairs + leastShare(f) * more, most = f.pairs + more;
  if (!(f.pairCost > 0.0)) return most;
  // At each scale, where the error that a ray takes away is the same in all regions, 1 / reach^2.
  double wanted = least;
  for (int k = 0; k < kScales; ++k) {
    const double bias = f.bias[k].square;
    if (!(bias > 0.0)) continue;
    const double known = reach * std::sqrt(f.pooling.pairs[k] * f.pairVariance / f.pairCost);
    wanted = std::max(wanted, (known - f.pairVariance / bias) / f.pooling.pairs[k]);
  }
  return std::min(wanted, most);
}

/// The pairs that so many rays pay for, best spread over the regions.
std::vector<double> spreadPairs(std::span<const ShareFigures> regions, double more, double rays) {
  std::vector<double> pairs(regions.size());
  const auto fill = [&](double reach) {
    double spent = 0.0;
    for (std::size_t i = 0; i < regions.size(); ++i) {
      pairs[i] = pairsAt(regions[i], reach, more);
      spent += regions[i].pixels * regions[i].pairCost * (pairs[i] - regions[i].pairs);
    }
    return spent;
  };
  constexpr int kSteps = 50;
  double low = -40.0, high = 40.0;  // logarithms of reach
  for (int i = 0; i < kSteps; ++i) {
    const double middle = 0.5 * (low + high);
    (fill(std::exp2(middle)) > rays ? high : low) = middle;
  }
  fill(std::exp2(low));
  return pairs;
}

}  // namespace

double leastShare(const ShareFigures& f) {
  return std::clamp(kPremium * f.guessCost / std::max(f.pairCost, 1e-30), kLeastShareOfPairs, 1.0);
}

double expectedError(const ShareFigures& f, double samples, double pairs) {
  double error = f.guessVariance / (f.pooling.guesses * samples);
  for (int k = 0; k < kScales; ++k) {
    const double bias = f.bias[k].square;
    if (!(bias > 0.0)) continue;
    const double doubt = pairs > 0.0 ? f.pairVariance / (f.pooling.pairs[k] * pairs) : HUGE_VAL;
    error += doubt < HUGE_VAL ? bias * doubt / (bias + doubt) : bias;
  }
  return error;
}

void poolBias(std::span<ShareFigures> regions) {
  double pixels = 0.0;
  for (const ShareFigures& f : regions) pixels += f.pixels;
  if (!(pixels > 0.0)) return;
  for (int k = 0; k < kScales; ++k) {
    double mean = 0.0, doubt = 0.0, spread = 0.0;
    for (const ShareFigures& f : regions) {
      mean += f.pixels / pixels * f.bias[k].square;
      doubt += f.pixels * f.pixels * f.bias[k].doubt * f.bias[k].doubt;
    }
    const double sure = std::max(mean - kSurely * std::sqrt(doubt) / pixels, 0.0);
    for (const ShareFigures& f : regions) {
      const double off = f.bias[k].square - mean;
      spread += f.pixels / pixels * (off * off - f.bias[k].doubt * f.bias[k].doubt);
    }
    spread = std::max(spread, 0.0);
    for (ShareFigures& f : regions) {
      auto& [square, error] = f.bias[k];
      const double all = spread + error * error, own = all > 0.0 ? spread / all : 1.0;
      square = std::max(sure + own * (square - mean), 0.0);
    }
  }
}

std::vector<double> chooseShares(std::span<const ShareFigures> regions, double samples) {
  double guessRays = 0.0, leastRays = 0.0, mostRays = 0.0, spent = 0.0;  // of a sample of all
  for (const ShareFigures& f : regions) {
    guessRays += f.pixels * f.guessCost;
    leastRays += f.pixels * (f.guessCost + leastShare(f) * f.pairCost);
    mostRays += f.pixels * (f.guessCost + f.pairCost);
    spent += f.pixels * (samples * f.guessCost + f.pairs * f.pairCost);
  }
  constexpr int kSteps = 24;
  double least = HUGE_VAL;
  std::vector<double> shares(regions.size());
  std::transform(regions.begin(), regions.end(), shares.begin(), leastShare);
  for (int i = 0; i <= kSteps; ++i) {
    const double rays = leastRays * std::pow(mostRays / leastRays, double{1} * i / kSteps);
    const double more = spent / rays;
    const auto pairs = spreadPairs(regions, more, std::max(spent - more * guessRays, 0.0));
    double error = 0.0;
    for (std::size_t k = 0; k < regions.size(); ++k) {
      error += regions[k].pixels * expectedError(regions[k], samples + more, pairs[k]);
    }
    if (!(error < least)) continue;
    least = error;
    for (std::size_t k = 0; k < regions.size(); ++k) {
      shares[k] = std::clamp((pairs[k] - regions[k].pairs) / more, leastShare(regions[k]), 1.0);
    }
  }
  return shares;
}

}  // namespace trex
