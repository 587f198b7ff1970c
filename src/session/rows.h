// Rows of a picture, by all threads.
#pragma once

#include <tbb/parallel_for.h>

#include <cstdint>
#include <vector>

namespace trex {

/// Calls row(y) for y in [0, height), in parallel.
template <typename Row>
void eachRow(std::uint32_t height, const Row& row) {
  tbb::parallel_for(0u, height, row);
}

/// Sum of the rows' `Sum`s, each of which row(y, sum) adds to; in the rows' order, so the same bits
/// for any number of threads.
template <typename Sum, typename Row>
Sum sumOfRows(std::uint32_t height, const Row& row) {
  std::vector<Sum> sums(height);
  eachRow(height, [&](std::uint32_t y) { row(y, sums[y]); });
  Sum all;
  for (const Sum& s : sums) all.add(s);
  return all;
}

}  // namespace trex
