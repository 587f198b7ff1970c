#include "src/machines/jobs.h"

#include <algorithm>
#include <cmath>

namespace trex::machines {
namespace {

constexpr double kLateSeconds = 1.0;  // below, no job counts as late
constexpr double kLateTimes = 4.0;    // of what it was expected to take
constexpr double kNewShare = 0.5;     // of a new rate in the one that is kept
constexpr std::size_t kMostHolders = 2;

}  // namespace

std::uint64_t unitsOfJob(const JobSizes& sizes, double wanted, std::uint64_t left,
                         std::uint32_t machines) {
  // The last jobs end together: each is a half of an equal share of what is left.
  const std::uint64_t fair = left / (2 * std::max(machines, 1u));
  const auto byTime = static_cast<std::uint64_t>(std::min(wanted, 1e15));
  const std::uint64_t units =
      std::max<std::uint64_t>(std::min({std::max<std::uint64_t>(byTime, 1), fair, sizes.most}), 1);
  if (sizes.together <= 1 || sizes.together > sizes.most) return units;
  const std::uint64_t whole = (units + sizes.together - 1) / sizes.together * sizes.together;
  return whole <= sizes.most ? whole : whole - sizes.together;
}

std::uint64_t unitsOfLargeJob(std::uint64_t large, std::uint64_t all, std::uint32_t machines,
                              double share) {
  const std::uint64_t atOnce = std::max<std::uint64_t>(large * machines, 1);
  const std::uint64_t rounds = std::max<std::uint64_t>((all + atOnce - 1) / atOnce, 1);
  const double units = std::ceil(static_cast<double>(all) * share / static_cast<double>(rounds));
  return std::clamp<std::uint64_t>(static_cast<std::uint64_t>(units), 1, large);
}

JobLedger::JobLedger(std::uint32_t machines) : machines_(machines) {}

void JobLedger::start(std::uint64_t first, std::uint64_t end, const JobSizes& sizes) {
  open_.clear();
  for (Machine& m : machines_) m.held = 0;
  sizes_ = sizes;
  first_ = next_ = merged_ = first;
  end_ = end;
}

void JobLedger::join(std::uint32_t machine) { machines_[machine].here = true; }

void JobLedger::lose(std::uint32_t machine) {
  machines_[machine].here = false;
  machines_[machine].held = 0;
  std::vector<std::uint32_t> large;
  for (auto& [id, open] : open_) {
    const std::size_t lost =
        std::erase_if(open.holders, [&](const Holder& h) { return h.machine == machine; });
    if (lost > 0 && open.holders.empty() && sizes_.large > 1) large.push_back(id);
  }
  for (const std::uint32_t id : large) part(id);
}

/// A job that nobody holds becomes several, of the same units. A result of it is of no use any
/// more.
void JobLedger::part(std::uint32_t id) {
  const Job job = open_.at(id).job;
  const std::uint64_t parts = std::min<std::uint64_t>(std::max(present(), 1u), job.units());
  open_.erase(id);
  for (std::uint64_t i = 0; i < parts; ++i) {
    const Job some{nextId_++, job.first + job.units() * i / parts,
                   job.first + job.units() * (i + 1) / parts};
    open_[some.id] = {some, {}};
  }
}

std::uint32_t JobLedger::present() const {
  return static_cast<std::uint32_t>(
      std::count_if(machines_.begin(), machines_.end(), [](const Machine& m) { return m.here; }));
}

/// What a machine traces of all that is traced: an equal part as long as speeds are not known.
double JobLedger::shareOf(std::uint32_t machine) const {
  double sum = 0.0;
  for (const Machine& m : machines_) {
    if (m.here && m.unitsASecond <= 0.0) return 1.0 / present();
    if (m.here) sum += m.unitsASecond;
  }
  return machines_[machine].unitsASecond / sum;
}

/// Of the next new job of a machine.
std::uint64_t JobLedger::unitsFor(std::uint32_t machine) const {
  if (sizes_.large > 1) {
    return unitsOfLargeJob(sizes_.large, end_ - first_, present(), shareOf(machine));
  }
  const double seconds = machine == 0 ? sizes_.ownSeconds : sizes_.seconds;
  const std::uint64_t units =
      unitsOfJob(sizes_, machines_[machine].unitsASecond * seconds, end_ - next_, present());
  // Whole samples end where samples end, wherever the range began.
  const bool whole = sizes_.together > 1 && units >= sizes_.together;
  return whole ? units - next_ % sizes_.together : units;
}

Job JobLedger::hand(Open& open, std::uint32_t machine, double now) {
  open.holders.push_back({machine, now});
  ++machines_[machine].held;
  return open.job;
}

/// The first job that nobody holds.
JobLedger::Open* JobLedger::lost() {
  for (auto& [id, open] : open_) {
    if (open.holders.empty()) return &open;
  }
  return nullptr;
}

/// The first job that another machine has had for long, by its own speed, or this one's if that is
/// not known yet. A machine may hold several: the last of them has waited for those before.
JobLedger::Open* JobLedger::late(std::uint32_t machine, double now) {
  for (auto& [id, open] : open_) {
    if (open.holders.size() >= kMostHolders || open.holders.front().machine == machine) continue;
    const double own = machines_[open.holders.front().machine].unitsASecond;
    const double rate = own > 0.0 ? own : machines_[machine].unitsASecond;
    if (rate <= 0.0) continue;
    const double expected = static_cast<double>(open.job.units() * sizes_.atOnce) / rate;
    if (now - open.holders.front().since > std::max(kLateSeconds, kLateTimes * expected)) {
      return &open;
    }
  }
  return nullptr;
}

std::optional<Job> JobLedger::deal(std::uint32_t machine, double now) {
  Machine& m = machines_[machine];
  if (!m.here || m.held >= sizes_.atOnce) return {};
  if (Open* open = lost()) {
    ++again_;
    return hand(*open, machine, now);
  }
  if (machine == 0) {
    if (Open* open = late(machine, now)) {
      ++again_;
      return hand(*open, machine, now);
    }
  }
  if (next_ < end_ && next_ - merged_ < sizes_.window) {
    const Job job{nextId_++, next_, std::min(next_ + unitsFor(machine), end_)};
    next_ = job.end;
    return hand(open_[job.id] = {job, {}}, machine, now);
  }
  if (machine == 0 || m.held > 0) return {};
  if (Open* open = late(machine, now)) {
    ++again_;
    return hand(*open, machine, now);
  }
  return {};
}

std::optional<Job> JobLedger::bring(std::uint32_t machine, std::uint32_t id, double seconds) {
  Machine& m = machines_[machine];
  const auto at = open_.find(id);
  if (at == open_.end()) {
    ++m.work.twice;
    return {};
  }
  const Job job = at->second.job;
  for (const Holder& h : at->second.holders) --machines_[h.machine].held;
  open_.erase(at);
  const auto units = static_cast<double>(job.units());
  if (seconds > 0.0) {
    const double rate = units / seconds;
    m.unitsASecond =
        m.unitsASecond > 0.0 ? m.unitsASecond + kNewShare * (rate - m.unitsASecond) : rate;
  }
  ++m.work.jobs;
  m.work.units += job.units();
  m.work.seconds += seconds;
  return job;
}

void JobLedger::giveBack(std::uint32_t machine, std::uint32_t id) {
  const auto at = open_.find(id);
  if (at == open_.end()) return;
  const std::size_t gone =
      std::erase_if(at->second.holders, [&](const Holder& h) { return h.machine == machine; });
  machines_[machine].held -= static_cast<std::uint32_t>(gone);
}

}  // namespace trex::machines
