// All that a choice of what to do next depends on.
#pragma once

#include <vector>

#include "src/schedule/graph.h"
#include "src/schedule/schedule.h"
#include "src/schedule/timing.h"

namespace trex::schedule {

/// Which copies go first where room is needed.
enum class Evict {
  kNeededLatest,   ///< least Item::need times the seconds of bringing it again
  kUsedLongestAgo  ///< least Item::lastUse
};

/// A job that has begun.
struct Running {
  std::uint32_t device = 0;
  double end = 0.0;                  ///< as expected; if it is past, the job overruns
  std::vector<std::uint32_t> reads;  ///< items that stay until then
  double scratch = 0.0;              ///< bytes
};

/// `graph`, `routes` and `timing` outlive it.
struct State {
  const Graph* graph = nullptr;
  const Routes* routes = nullptr;
  const TimingModel* timing = nullptr;
  Evict rivalsEvict = Evict::kUsedLongestAgo;  ///< of the rivals of planner.h
  double now = 0.0;                            ///< seconds
  /// Seconds that a job may begin later than it could if nothing else were planned; what begins
  /// later is left to later plans. kNever: plan all.
  double horizon = 0.0;
  /// Seconds for which a plan is kept; see plan(). 0: all is planned anew at every call.
  double patience = 0.0;
  std::vector<Item> items;
  std::vector<Job> jobs;         ///< that have not begun
  std::vector<Running> running;  ///< at most one a device
  std::vector<Fetch> moving;     ///< at most one a channel; `end` as Running's
};

/// Throws Error(kInput) for numbers out of range, values that are negative or not finite, copies in
/// memories that do not exist, and a job with work that no device can ever do: an item of it has no
/// copy that can reach one. Once for a kind of state is enough: plan() does not check.
void checkState(const State& state);

}  // namespace trex::schedule
