// What no schedule can beat.
#pragma once

#include "src/schedule/graph.h"
#include "src/schedule/timing.h"
#include "src/schedule/walks.h"

namespace trex::schedule {

/// Seconds below which no schedule of the workload ends that begins with stores alone full: the
/// largest of
///   work      all units at the sum of all devices' rates, no setup;
///   loads     the bytes that have to leave the stores at the sum of their channels' bandwidths.
/// Bytes: let b be the station, among any set of them, whose items are there last for the first
/// time. Until then the whole set has been loaded. Units that visit b have not yet been there, so
/// what they visit later comes after; of that no more than all memories together hold is there
/// already; and so on, `depth` times. The set is chosen so that the worst b is best.
struct Bound {
  double work = 0.0, loads = 0.0;  ///< seconds
  double bytes = 0.0;              ///< that leave the stores
  double seconds() const { return work > loads ? work : loads; }
};
/// The best times of jobs are those of `timing`, transfers take no less than their channels say.
Bound lowerBound(const Workload& workload, const Graph& graph, const TimingModel& timing,
                 int depth = 3);

}  // namespace trex::schedule
