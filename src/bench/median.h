// What measurements report.
#pragma once

#include <algorithm>
#include <functional>
#include <vector>

#include "src/core/clock.h"

namespace trex {

/// The middle one, the upper of two; there must be one.
inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// What some work takes: at least a nanosecond.
inline double secondsOf(const std::function<void()>& work) {
  const double start = secondsNow();
  work();
  return std::max(secondsNow() - start, 1e-9);
}

}  // namespace trex
