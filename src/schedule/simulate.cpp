#include "src/schedule/simulate.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "src/core/error.h"
#include "src/schedule/forecast.h"
#include "src/schedule/random.h"

namespace trex::schedule {
namespace {

constexpr int kStepsAhead = 8;  ///< of units, when it is judged what is needed latest
/// Share of what goes from a block to another that is taken to go back: of 0, .02, .1, .3 and 1 the
/// middle ones load least.
constexpr double kBackward = 0.2;
/// Of a block that is not there: the more of its units are still to come, the longer it waits,
/// since what is there by then does not need another load. By the share of all items that memories
/// do not hold: where all fits, nothing is loaded again, and the earlier the better.
constexpr double kPatience = 8.0;
/// Of a block that nobody knows anything of.
constexpr double kLeastNeed = 1e-6;

/// A unit, or units that go together: a walk and how far it is.
struct Unit {
  std::uint32_t walk = 0, place = 0;
};

struct ActiveRun {
  Run run;
  double expectedEnd = 0.0;
  std::vector<Unit> units;
};

struct ActiveFetch {
  Fetch fetch;
  double expectedEnd = 0.0;
  std::vector<Unit> units;  ///< of an item that moves
};

class Simulation {
 public:
  explicit Simulation(const SimulationInput& in)
      : in_(in),
        w_(*in.workload),
        graph_(*in.graph),
        routes_(*in.graph, typicalBytes()),
        noise_(in.disturbance.seed),
        forecast_(w_.stations(), kBackward) {
    for (const Device& d : graph_.devices) {
      if (std::find(hosts_.begin(), hosts_.end(), d.host) == hosts_.end()) hosts_.push_back(d.host);
    }
    queues_.resize(w_.stations() * hosts_.size());
    double held = 0.0;
    for (const Memory& m : graph_.memories) held += std::isfinite(m.capacity) ? m.capacity : 0.0;
    const double all = std::accumulate(w_.itemBytes.begin(), w_.itemBytes.end(), 0.0);
    patience_ = all > held ? kPatience * (1.0 - held / all) : 0.0;
    makeItems();
    makeJobs();
    children_.resize(w_.walks.size());
    std::uint32_t roots = 0;
    for (std::uint32_t i = 0; i < w_.walks.size(); ++i) {
      const Walk& walk = w_.walks[i];
      if (walk.parent == kNoWalk) {
        queue({i, 0}, roots++ % hosts_.size());
      } else {
        children_[walk.parent].push_back(i);
      }
    }
    result_.items = state_.items;
    result_.jobs = state_.jobs;
  }

  SimulationResult play() {
    refreshState();
    checkState(state_);
    while (true) {
      refreshState();
      previous_ = in_.planner(state_, previous_);
      ++result_.plans;
      begin();
      if (runs_.empty() && fetches_.empty()) break;
      advance();
    }
    const double left = waiting_;
    if (left > 0.0) {
      fail(ExitCode::kFailed, "simulation: {} walks are left that the scheduler does not serve",
           left);
    }
    finish();
    return std::move(result_);
  }

 private:
  double typicalBytes() const {
    double sum = 1.0;
    for (double bytes : w_.itemBytes) sum += bytes;
    return sum / std::max<double>(1.0, static_cast<double>(w_.itemBytes.size()));
  }

  std::uint32_t queueItem(std::uint32_t station, std::size_t host) const {
    return static_cast<std::uint32_t>(w_.itemBytes.size() + station * hosts_.size() + host);
  }

  void makeItems() {
    std::uint64_t stores = 0;
    for (std::size_t m = 0; m < graph_.memories.size(); ++m) {
      if (!std::isfinite(graph_.memories[m].capacity)) stores |= std::uint64_t{1} << m;
    }
    for (double bytes : w_.itemBytes) state_.items.push_back({bytes, stores, false, 0.0, 0.0});
    for (std::uint32_t b = 0; b < w_.stations(); ++b) {
      for (std::uint32_t host : hosts_) {
        state_.items.push_back({0.0, std::uint64_t{1} << host, true, 0.0, 0.0});
      }
    }
  }

  void makeJobs() {
    state_.graph = &graph_;
    state_.routes = &routes_;
    state_.timing = in_.assumed;
    state_.horizon = in_.horizon;
    state_.patience = in_.patience;
    state_.rivalsEvict = in_.rivalsEvict;
    for (std::uint32_t b = 0; b < w_.stations(); ++b) {
      Job job;
      job.reads = w_.reads[b];
      for (std::size_t h = 0; h < hosts_.size(); ++h) job.reads.push_back(queueItem(b, h));
      job.amounts = {0.0};
      job.scratch = w_.scratch[b];
      state_.jobs.push_back(std::move(job));
    }
    for (const Walk& walk : w_.walks) {
      for (std::uint32_t k = 0; k < walk.length; ++k) {
        state_.jobs[w_.way[walk.first + k]].kind = walk.kind;
      }
    }
    queued_.resize(w_.stations());
    resident_.resize(w_.stations());
  }

  void queue(Unit unit, std::size_t host) {
    const std::uint32_t station = w_.way[w_.walks[unit.walk].first + unit.place];
    if (queuedWalks(station) == 0) state_.jobs[station].readySince = state_.now;
    queues_[station * hosts_.size() + host].push_back(unit);
    ++waiting_;
  }

  std::size_t queuedWalks(std::uint32_t station) const {
    std::size_t sum = 0;
    for (std::size_t h = 0; h < hosts_.size(); ++h)
      sum += queues_[station * hosts_.size() + h].size();
    return sum;
  }

  bool resident(std::uint32_t station) const {
    return std::all_of(w_.reads[station].begin(), w_.reads[station].end(), [&](std::uint32_t item) {
      const std::uint64_t copies = state_.items[item].copies;
      return std::any_of(graph_.devices.begin(), graph_.devices.end(),
                         [&](const Device& d) { return copies >> d.memory & 1u; });
    });
  }

  void refreshState() {
    for (std::uint32_t b = 0; b < w_.stations(); ++b) {
      double units = 0.0;
      for (std::size_t h = 0; h < hosts_.size(); ++h) {
        const double here =
            w_.unitsPerWalk * static_cast<double>(queues_[b * hosts_.size() + h].size());
        state_.items[queueItem(b, h)].bytes = here * w_.unitBytes;
        units += here;
      }
      queued_[b] = units;
      state_.jobs[b].amounts[0] = std::min(units, in_.mostUnits);
      resident_[b] = resident(b);
    }
    judge();
    state_.running.clear();
    for (const ActiveRun& r : runs_) {
      state_.running.push_back(
          {r.run.device, r.expectedEnd, w_.reads[r.run.job], w_.scratch[r.run.job]});
    }
    state_.moving.clear();
    for (const ActiveFetch& f : fetches_) {
      state_.moving.push_back(f.fetch);
      state_.moving.back().end = f.expectedEnd;
    }
  }

  /// What jobs are worth, and how soon items are needed: by what waits and what is expected. That
  /// changes slowly, and is asked again as seldom as all is planned anew.
  void judge() {
    std::vector<double> coming(w_.stations(), 0.0);
    if (in_.forecast) coming = forecast_.coming(queued_, 1, resident_);
    if (in_.forecast && (later_.empty() || state_.now >= judged_ + in_.patience)) {
      later_ = forecast_.coming(queued_, kStepsAhead);
      judged_ = state_.now;
    }
    if (later_.empty()) later_.resize(w_.stations(), 0.0);
    for (std::size_t i = 0; i < w_.itemBytes.size(); ++i) state_.items[i].need = kLeastNeed;
    for (std::uint32_t b = 0; b < w_.stations(); ++b) {
      const double now = queued_[b] + coming[b], later = std::max(0.0, later_[b] - coming[b]);
      double& worth = state_.jobs[b].worth;
      worth = queued_[b] > 0.0 ? now : 0.0;
      if (worth > 0.0 && !resident_[b]) worth *= now / (now + patience_ * later);
      for (std::uint32_t item : w_.reads[b]) state_.items[item].need += queued_[b] + later_[b];
    }
  }

  void evict(const std::vector<std::uint32_t>& items, std::uint32_t memory) {
    for (std::uint32_t item : items) state_.items[item].copies &= ~(std::uint64_t{1} << memory);
  }

  void begin() {
    std::vector<Run> later;
    for (Fetch& f : previous_.fetches) {
      if (f.start <= state_.now) beginFetch(std::move(f));
    }
    previous_.fetches.clear();
    for (Run& r : previous_.runs) {
      if (r.start <= state_.now) {
        beginRun(std::move(r));
      } else {
        later.push_back(std::move(r));
      }
    }
    previous_.runs = std::move(later);
  }

  void beginFetch(Fetch f) {
    ActiveFetch active;
    active.expectedEnd = f.end;
    const double length =
        (f.end - f.start) * (1.0 + in_.disturbance.transferNoise * std::abs(noise_.normal()));
    const Item& item = state_.items[f.item];
    if (item.moves) {
      std::vector<Unit>& from = queues_[f.item - w_.itemBytes.size()];
      waiting_ -= static_cast<double>(from.size());
      active.units = std::move(from);
      from.clear();
    } else {
      evict(f.evicted, f.to);
      if (!std::isfinite(graph_.memories[f.from].capacity)) {
        result_.loadedBytes += item.bytes;
        ++result_.loads;
      }
    }
    f.end = f.start + length;
    result_.happened.fetches.push_back(f);
    active.fetch = std::move(f);
    fetches_.push_back(std::move(active));
  }

  void beginRun(Run r) {
    ActiveRun active;
    active.expectedEnd = r.end;
    evict(r.evicted, graph_.devices[r.device].memory);
    const std::size_t host = hostOf(r.device);
    std::vector<Unit>& from = queues_[r.job * hosts_.size() + host];
    const auto most =
        static_cast<std::size_t>(std::max(1.0, std::floor(in_.mostUnits / w_.unitsPerWalk)));
    const std::size_t count = std::min(most, from.size());
    active.units.assign(from.begin(), from.begin() + static_cast<long>(count));
    from.erase(from.begin(), from.begin() + static_cast<long>(count));
    waiting_ -= static_cast<double>(count);
    if (!from.empty()) state_.jobs[r.job].readySince = state_.now;
    const double amounts[] = {static_cast<double>(count) * w_.unitsPerWalk};
    const std::uint32_t kind = state_.jobs[r.job].kind;
    double length = in_.truth->at(r.device, kind).seconds(amounts) *
                    (1.0 + in_.disturbance.jobNoise * std::abs(noise_.normal()));
    if (noise_() < in_.disturbance.overrunShare) length *= in_.disturbance.overrunFactor;
    const double assumed = in_.assumed->at(r.device, kind).seconds(amounts);
    active.expectedEnd = r.start + assumed;
    if (length > 0.0) result_.timingErrors.push_back(std::abs(assumed - length) / length);
    r.end = r.start + length;
    result_.happened.runs.push_back(r);
    active.run = std::move(r);
    runs_.push_back(std::move(active));
  }

  std::size_t hostOf(std::uint32_t device) const {
    return static_cast<std::size_t>(
        std::find(hosts_.begin(), hosts_.end(), graph_.devices[device].host) - hosts_.begin());
  }

  /// To the next end of anything.
  void advance() {
    double next = kNever;
    for (const ActiveRun& r : runs_) next = std::min(next, r.run.end);
    for (const ActiveFetch& f : fetches_) next = std::min(next, f.fetch.end);
    state_.now = next;
    for (std::size_t i = 0; i < fetches_.size();) {
      if (fetches_[i].fetch.end > next) {
        ++i;
        continue;
      }
      ActiveFetch done = std::move(fetches_[i]);
      fetches_.erase(fetches_.begin() + static_cast<long>(i));
      arrive(done);
    }
    for (std::size_t i = 0; i < runs_.size();) {
      if (runs_[i].run.end > next) {
        ++i;
        continue;
      }
      ActiveRun done = std::move(runs_[i]);
      runs_.erase(runs_.begin() + static_cast<long>(i));
      end(done);
    }
  }

  void arrive(ActiveFetch& done) {
    if (state_.items[done.fetch.item].moves) {
      const std::size_t host = static_cast<std::size_t>(
          std::find(hosts_.begin(), hosts_.end(), done.fetch.to) - hosts_.begin());
      for (const Unit& unit : done.units) queue(unit, host);
    } else {
      state_.items[done.fetch.item].copies |= std::uint64_t{1} << done.fetch.to;
    }
  }

  void end(ActiveRun& done) {
    const Run& r = done.run;
    const std::size_t host = hostOf(r.device);
    for (std::uint32_t item : w_.reads[r.job]) state_.items[item].lastUse = state_.now;
    forecast_.served(r.job, static_cast<double>(done.units.size()) * w_.unitsPerWalk);
    for (const Unit& unit : done.units) {
      if (unit.place + 1 < w_.walks[unit.walk].length) {
        go({unit.walk, unit.place + 1}, r.job, host);
      }
      for (std::uint32_t child : children_[unit.walk]) {
        if (w_.walks[child].parentPlace == unit.place) go({child, 0}, r.job, host);
      }
    }
  }

  void go(Unit unit, std::uint32_t from, std::size_t host) {
    queue(unit, host);
    forecast_.moved(from, w_.way[w_.walks[unit.walk].first + unit.place], w_.unitsPerWalk);
  }

  void finish() {
    result_.makespan = result_.happened.makespan();
    double busy = 0.0;
    for (const Run& r : result_.happened.runs) busy += r.end - r.start;
    if (result_.makespan > 0.0) {
      result_.busyShare = busy / (result_.makespan * static_cast<double>(graph_.devices.size()));
    }
  }

  const SimulationInput& in_;
  const Workload& w_;
  const Graph& graph_;
  Routes routes_;
  Random noise_;
  Forecast forecast_;
  State state_;
  Schedule previous_;
  SimulationResult result_;
  std::vector<std::uint32_t> hosts_;       ///< memories
  std::vector<std::vector<Unit>> queues_;  ///< of each station and host
  std::vector<std::vector<std::uint32_t>> children_;
  std::vector<double> queued_;  ///< units at each station
  std::vector<double> later_;   ///< units that are expected, as of `judged_`
  double judged_ = 0.0, patience_ = 0.0;
  std::vector<char> resident_;  ///< a device can serve the station as it is
  std::vector<ActiveRun> runs_;
  std::vector<ActiveFetch> fetches_;
  double waiting_ = 0.0;  ///< walks in queues
};

}  // namespace

SimulationResult simulate(const SimulationInput& input) { return Simulation(input).play(); }

}  // namespace trex::schedule
