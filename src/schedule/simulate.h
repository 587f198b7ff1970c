// A machine that is not there plays a workload: jobs and transfers take their true times, which the
// scheduler does not know, and it is asked again whenever one ends.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/schedule/graph.h"
#include "src/schedule/planner.h"
#include "src/schedule/schedule.h"
#include "src/schedule/timing.h"
#include "src/schedule/walks.h"

namespace trex::schedule {

/// What a simulated machine truly does. All factors are at least 1: rates of graph and timing are
/// those of a machine that nothing disturbs.
struct Truth {
  double jobNoise = 0.15;       ///< factor of a job's time: 1 + this * |a normal number|
  double transferNoise = 0.10;  ///< likewise
  double overrunShare = 0.02;   ///< of jobs that overrun ...
  double overrunFactor = 3.0;   ///< ... by this
  std::uint64_t seed = 1;
};

struct SimulationInput {
  const Graph* graph = nullptr;
  const TimingModel* truth = nullptr;    ///< of an undisturbed machine
  const TimingModel* assumed = nullptr;  ///< what the scheduler believes
  const Workload* workload = nullptr;
  Truth disturbance;
  Planner planner = nullptr;
  Evict rivalsEvict = Evict::kUsedLongestAgo;
  bool forecast = true;    ///< Job::worth and Item::need count what is expected, too
  double mostUnits = 2e6;  ///< of one job; the rest waits for the next
  double horizon = 0.2;    ///< State::horizon; half of the time of a load or so
  double patience = 0.03;  ///< State::patience
};

struct SimulationResult {
  Schedule happened;
  std::vector<Item> items;  ///< as they were before, for problemOf()
  std::vector<Job> jobs;
  double makespan = 0.0;     ///< seconds
  double loadedBytes = 0.0;  ///< that left a store
  std::uint64_t loads = 0;   ///< transfers from a store
  double busyShare = 0.0;    ///< of all devices' time until the makespan
  std::uint64_t plans = 0;
  std::vector<double> timingErrors;  ///< |assumed - true| / true, of each job
};

/// Plays until every unit has ended. Units without a parent begin evenly in all host memories.
/// Stations are jobs; items are those of the workload, then a queue for each station and host.
/// Throws Error(kInput) for what checkState() refuses, Error(kFailed) if a scheduler leaves work
/// undone for ever. A pure function.
SimulationResult simulate(const SimulationInput& input);

}  // namespace trex::schedule
