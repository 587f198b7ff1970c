// What to do next: greedy makespan balancing, after Son and Yoon (HPG 2017), and its rivals.
//
// Of all pairs of a job and a device the best by a rule is taken; what the job reads is brought
// over the cheapest path from any copy, through the earliest free slots of each channel; what is
// needed latest is evicted; again, until nothing more begins before the horizon. All of them are
// pure functions: a plan depends on its arguments alone, and on nothing twice. Thread safe.
#pragma once

#include <span>

#include "src/schedule/state.h"

namespace trex::schedule {

enum class Rule {
  kMostWork,        ///< most Job::worth for each second until it is done
  kEarliestStart,   ///< the job that can start soonest [Son and Yoon 2017]
  kEarliestFinish,  ///< the job that can end soonest
};
constexpr Rule kDefaultRule = Rule::kMostWork;

/// `previous` is what the same function said last, less what has begun since. Until
/// State::patience is over that is kept, and only devices without work get more; then, and when a
/// store's channel has run out of work, all is planned anew, and channels that are idle even so
/// bring what is needed most (Item::need) of what is in stores alone, if there is room.
Schedule plan(const State& state, const Schedule& previous, Rule rule = kDefaultRule);

/// Jobs by number, in turn, to whichever device is idle; data is brought when the job is taken.
Schedule planRoundRobin(const State& state, const Schedule& previous);

/// The job with most worth, to whichever device is idle, no matter where its data is; data is
/// brought then. LoadAnyOnce [Navratil et al. 2014].
Schedule planLoadAnyOnce(const State& state, const Schedule& previous);

/// Each job, once it is ready, to the device that would end it first, transfers included, behind
/// what that has to do; data is brought ahead. The rule `dmda` of StarPU [Augonnet et al. 2011].
Schedule planDmda(const State& state, const Schedule& previous);

using Planner = Schedule (*)(const State& state, const Schedule& previous);

struct NamedPlanner {
  const char* name;
  Planner plan;
  bool foresees;  ///< Job::worth counts work that is expected, not only what waits
};
/// All of them: the default rule first, then ours, then the rivals.
std::span<const NamedPlanner> allPlanners();

}  // namespace trex::schedule
