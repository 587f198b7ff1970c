// What measurements report.
#pragma once

#include <algorithm>
#include <vector>

namespace trex {

/// The middle one, the upper of two; there must be one.
inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace trex
