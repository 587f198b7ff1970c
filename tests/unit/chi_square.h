// Pearson's chi-square test of counts against expected counts.
#pragma once

#include <cmath>
#include <vector>

namespace trex::test {

/// Upper tail of the chi-square distribution with k degrees of freedom: the Wilson-Hilferty normal
/// approximation, good to a few percent of p for k >= 10.
inline double chiSquareTail(double statistic, double k) {
  const double x = std::cbrt(statistic / k);
  const double mean = 1.0 - 2.0 / (9.0 * k), deviation = std::sqrt(2.0 / (9.0 * k));
  return 0.5 * std::erfc((x - mean) / (deviation * std::sqrt(2.0)));
}

/// p-value of the counts; cells that expect less than five are pooled.
inline double chiSquareP(const std::vector<double>& counts, const std::vector<double>& expected) {
  double statistic = 0.0, pooledCount = 0.0, pooledExpected = 0.0;
  int cells = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (expected[i] < 5.0) {
      pooledCount += counts[i];
      pooledExpected += expected[i];
    } else {
      const double d = counts[i] - expected[i];
      statistic += d * d / expected[i];
      ++cells;
    }
  }
  if (pooledExpected > 5.0) {
    const double d = pooledCount - pooledExpected;
    statistic += d * d / pooledExpected;
    ++cells;
  } else if (pooledCount > 25.0) {
    return 0.0;  // samples where next to none may be
  }
  return cells > 1 ? chiSquareTail(statistic, cells - 1.0) : 1.0;
}

}  // namespace trex::test
