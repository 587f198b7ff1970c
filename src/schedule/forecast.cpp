#include "src/schedule/forecast.h"

namespace trex::schedule {

constexpr double kHardly = 1e-3;

std::vector<double> Forecast::coming(std::span<const double> queued, int steps,
                                     std::span<const char> open) const {
  std::vector<double> sum(stations_, 0.0), now(queued.begin(), queued.end()), next;
  for (int step = 0; step < steps; ++step) {
    next.assign(stations_, 0.0);
    for (std::uint32_t from = 0; from < stations_; ++from) {
      if ((!open.empty() && !open[from]) || now[from] <= 0.0 || served_[from] <= 0.0) continue;
      const double share = now[from] / served_[from];
      const double* row = &moved_[std::size_t{from} * stations_];
      for (const std::uint32_t to : next_[from]) next[to] += share * row[to];
    }
    double left = 0.0, all = 0.0;
    for (std::uint32_t b = 0; b < stations_; ++b) {
      sum[b] += next[b];
      left += next[b];
      all += sum[b];
    }
    if (left < kHardly * all) break;
    now.swap(next);
  }
  return sum;
}

}  // namespace trex::schedule
