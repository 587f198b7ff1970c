#include "src/schedule/planner.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <queue>

#include "src/schedule/board.h"

namespace trex::schedule {
namespace {

/// A second of a store's channel that brings what is in another memory already counts as so many
/// more if all that is needed is in stores alone, and as none if nothing is: all wait for that
/// channel then, and units of work can go to where the item is.
constexpr double kAgain = 8.0;
/// Of the horizon: what begins so soon is given out between two whole plans.
constexpr double kSoon = 0.1;

bool hasWork(const Job& job) {
  return std::any_of(job.amounts.begin(), job.amounts.end(), [](double a) { return a > 0.0; });
}

struct Pair {
  double key = 0.0;     ///< less is better
  double latest = 0.0;  ///< start that is not beyond the horizon
  std::uint32_t job = 0, device = 0;
  bool operator>(const Pair& other) const {
    if (key != other.key) return key > other.key;
    return job != other.job ? job > other.job : device > other.device;
  }
};

double keyOf(const State& s, Rule rule, const Job& job, const Offer& offer, double again) {
  switch (rule) {
    case Rule::kEarliestStart:
      return offer.start;
    case Rule::kEarliestFinish:
      return offer.end;
    case Rule::kMostWork:
      break;
  }
  return (offer.end - s.now + again * offer.again) / std::max(job.worth, 1e-300);
}

/// Commits the best pairs of a job and one of these devices until nothing more begins within the
/// horizon; `latest`: of what could not begin by then if it were alone, nothing. Keys only grow
/// while more is committed (nearly: a copy may come nearer), so a pair is looked at again only once
/// it is the first [lazy greedy: Minoux 1978], and cheaply at first.
void commitBest(Board& board, const State& state, Rule rule, std::span<const std::uint32_t> devices,
                double latest, std::vector<bool>& committed) {
  const double again = kAgain * board.neededFromStores();
  std::vector<Pair> pairs;
  for (std::uint32_t j = 0; j < state.jobs.size(); ++j) {
    if (committed[j] || !hasWork(state.jobs[j])) continue;
    for (const std::uint32_t d : devices) {
      const Offer offer = board.atBest(j, d);
      if (!offer.possible() || offer.start > latest) continue;
      pairs.push_back(
          {keyOf(state, rule, state.jobs[j], offer, again), offer.start + state.horizon, j, d});
    }
  }
  std::priority_queue<Pair, std::vector<Pair>, std::greater<>> queue(std::greater<>(),
                                                                     std::move(pairs));
  bool any = false;
  while (!queue.empty()) {
    Pair p = queue.top();
    queue.pop();
    if (committed[p.job]) continue;
    const auto isFirst = [&](const Offer& offer) {
      if (!offer.possible() || (any && offer.start > p.latest)) return false;
      p.key = std::max(p.key, keyOf(state, rule, state.jobs[p.job], offer, again));
      if (queue.empty() || !(p > queue.top())) return true;
      queue.push(p);
      return false;
    };
    if (!isFirst(board.atBest(p.job, p.device)) || !isFirst(board.place(p.job, p.device))) continue;
    board.commitPlaced(p.job, p.device);
    committed[p.job] = any = true;
  }
}

/// Channels that leave a store and bring something, or will.
std::uint64_t feeding(const State& state, const Schedule& made) {
  std::uint64_t channels = 0;
  const auto note = [&](const Fetch& f) {
    if (f.channel < 64 && !std::isfinite(state.graph->memories[f.from].capacity)) {
      channels |= std::uint64_t{1} << f.channel;
    }
  };
  std::for_each(state.moving.begin(), state.moving.end(), note);
  std::for_each(made.fetches.begin(), made.fetches.end(), note);
  return channels;
}

/// What was planned is kept, in its order; devices that have nothing to do get what can begin soon.
/// False if all has to be planned anew: it is time, all stands still, or a store's channel has run
/// out of work.
bool goOn(const State& state, const Schedule& previous, Rule rule, Schedule& made) {
  const bool stands = state.running.empty() && state.moving.empty();
  if (stands || !(state.now < previous.whole + state.patience)) return false;
  Board board(state, Evict::kNeededLatest);
  std::vector<bool> committed(state.jobs.size(), false);
  for (const Run& r : previous.runs) {
    if (committed[r.job] || !hasWork(state.jobs[r.job])) continue;
    committed[r.job] = board.commit(r.job, r.device).possible();
  }
  std::vector<std::uint32_t> idle;
  for (std::uint32_t d = 0; d < state.graph->devices.size(); ++d) {
    if (board.deviceEnd(d) <= state.now) idle.push_back(d);
  }
  if (!idle.empty()) {
    commitBest(board, state, rule, idle, state.now + kSoon * state.horizon, committed);
  }
  made = std::move(board.schedule());
  made.whole = previous.whole;
  made.feeding = previous.feeding;
  return (previous.feeding & ~feeding(state, made)) == 0;
}

}  // namespace

Schedule plan(const State& state, const Schedule& previous, Rule rule) {
  Schedule made;
  if (goOn(state, previous, rule, made)) return made;
  Board board(state, Evict::kNeededLatest);
  std::vector<bool> committed(state.jobs.size(), false);
  std::vector<std::uint32_t> devices(state.graph->devices.size());
  std::iota(devices.begin(), devices.end(), 0u);
  commitBest(board, state, rule, devices, kNever, committed);
  const bool works = !state.running.empty() || !board.schedule().runs.empty();
  for (std::uint32_t c = 0; c < state.graph->channels.size() && works; ++c) board.bringAhead(c);
  made = std::move(board.schedule());
  made.whole = state.now;
  made.feeding = feeding(state, made);
  return made;
}

namespace {

/// What a job reads is on its way.
bool isAwaited(const State& state, const Job& job) {
  return std::any_of(state.moving.begin(), state.moving.end(), [&](const Fetch& f) {
    return std::find(job.reads.begin(), job.reads.end(), f.item) != job.reads.end();
  });
}

/// What was assigned before stays where it is, in its order; without a time if all of its work is
/// on the way.
std::vector<bool> keepAssigned(Board& board, const State& state, const Schedule& previous) {
  std::vector<bool> assigned(state.jobs.size(), false);
  for (const Run& r : previous.runs) {
    if (assigned[r.job]) continue;
    if (hasWork(state.jobs[r.job])) {
      assigned[r.job] = board.commit(r.job, r.device).possible();
    } else if (isAwaited(state, state.jobs[r.job])) {
      board.schedule().runs.push_back({r.job, r.device, kNever, kNever, {}});
      assigned[r.job] = true;
    }
  }
  return assigned;
}

bool isIdle(Board& board, const State& state, std::uint32_t device) {
  const std::vector<Run>& runs = board.schedule().runs;
  return board.deviceEnd(device) <= state.now &&
         std::none_of(runs.begin(), runs.end(), [&](const Run& r) { return r.device == device; });
}

/// Gives each idle device the job that `next` says, while there is one.
template <typename Next>
Schedule planOnDemand(const State& state, const Schedule& previous, const Next& next) {
  Board board(state, state.rivalsEvict);
  std::vector<bool> assigned = keepAssigned(board, state, previous);
  std::uint32_t cursor = previous.cursor;
  for (std::uint32_t d = 0; d < state.graph->devices.size(); ++d) {
    if (!isIdle(board, state, d)) continue;
    const std::uint32_t job = next(assigned, cursor);
    if (job >= state.jobs.size()) break;
    assigned[job] = board.commit(job, d).possible();
    if (assigned[job]) cursor = job + 1;
  }
  Schedule made = std::move(board.schedule());
  made.cursor = cursor;
  return made;
}

}  // namespace

Schedule planRoundRobin(const State& state, const Schedule& previous) {
  const auto jobs = static_cast<std::uint32_t>(state.jobs.size());
  return planOnDemand(state, previous, [&](const std::vector<bool>& assigned, std::uint32_t from) {
    for (std::uint32_t k = 0; k < jobs; ++k) {
      const std::uint32_t j = (from + k) % jobs;
      if (!assigned[j] && hasWork(state.jobs[j])) return j;
    }
    return jobs;
  });
}

Schedule planLoadAnyOnce(const State& state, const Schedule& previous) {
  const auto jobs = static_cast<std::uint32_t>(state.jobs.size());
  return planOnDemand(state, previous, [&](const std::vector<bool>& assigned, std::uint32_t) {
    std::uint32_t best = jobs;
    for (std::uint32_t j = 0; j < jobs; ++j) {
      if (assigned[j] || !hasWork(state.jobs[j])) continue;
      if (best == jobs || state.jobs[j].worth > state.jobs[best].worth) best = j;
    }
    return best;
  });
}

Schedule planDmda(const State& state, const Schedule& previous) {
  Board board(state, state.rivalsEvict);
  const std::vector<bool> assigned = keepAssigned(board, state, previous);
  std::vector<std::uint32_t> ready;
  for (std::uint32_t j = 0; j < state.jobs.size(); ++j) {
    if (!assigned[j] && hasWork(state.jobs[j])) ready.push_back(j);
  }
  std::stable_sort(ready.begin(), ready.end(), [&](std::uint32_t a, std::uint32_t b) {
    return state.jobs[a].readySince < state.jobs[b].readySince;
  });
  for (std::uint32_t j : ready) {
    Offer best;
    std::uint32_t device = 0;
    for (std::uint32_t d = 0; d < state.graph->devices.size(); ++d) {
      const Offer offer = board.place(j, d);
      if (!offer.possible() || offer.end >= best.end) continue;
      best = offer;
      device = d;
    }
    if (best.possible()) board.commit(j, device);
  }
  return std::move(board.schedule());
}

std::span<const NamedPlanner> allPlanners() {
  static constexpr NamedPlanner kPlanners[] = {
      {"most work",
       [](const State& s, const Schedule& before) { return plan(s, before, Rule::kMostWork); },
       true},
      {"earliest start",
       [](const State& s, const Schedule& before) { return plan(s, before, Rule::kEarliestStart); },
       true},
      {"earliest finish",
       [](const State& s, const Schedule& before) {
         return plan(s, before, Rule::kEarliestFinish);
       },
       true},
      {"round robin", planRoundRobin, false},
      {"LoadAnyOnce", planLoadAnyOnce, false},
      {"dmda", planDmda, false},
  };
  return kPlanners;
}

}  // namespace trex::schedule
