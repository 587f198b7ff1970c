#include "src/machines/loans.h"

#include <algorithm>

namespace trex::machines {
namespace {

constexpr double kNewRate = 0.5;  // of a new rate in the one that is kept
// A loan is late after so many times what it was expected to take, and some more; where nothing is
// known of a machine, after kUnknownSeconds.
constexpr double kTimes = 4.0, kMoreSeconds = 0.25;
constexpr double kHurryTimes = 1.5, kHurrySeconds = 0.02;
constexpr double kUnknownSeconds = 1.0;

}  // namespace

std::uint64_t Loans::wanted(std::uint32_t machine, double seconds) const {
  const Machine& m = machines_[machine];
  if (!m.owed.empty() || m.held >= kAtOnce) return 0;
  return std::max<std::uint64_t>(static_cast<std::uint64_t>(m.rate * seconds), 1);
}

std::uint32_t Loans::lend(std::uint32_t machine, std::vector<TileUnit> units, std::uint64_t samples,
                          double now) {
  Machine& m = machines_[machine];
  std::uint64_t before = 0;
  for (const auto& [id, loan] : loans_) before += loan.machine == machine ? loan.samples : 0;
  const std::uint32_t id = nextId_++;
  const double expected = m.rate > 0.0 ? static_cast<double>(before + samples) / m.rate : 0.0;
  loans_[id] = {id, machine, std::move(units), samples, now, expected};
  ++m.held;
  return id;
}

const Loan* Loans::find(std::uint32_t machine, std::uint32_t id) const {
  const auto at = loans_.find(id);
  return at != loans_.end() && at->second.machine == machine ? &at->second : nullptr;
}

void Loans::brought(std::uint32_t machine, std::uint32_t id, double seconds, double at) {
  Machine& m = machines_[machine];
  if (find(machine, id) == nullptr) {
    m.owed.erase(id);
    return;
  }
  Loan& loan = loans_.at(id);
  if (loan.back) return;
  loan.back = true;
  --m.held;
  // The link may take longer than the machine.
  const double taken = std::max({seconds, at - std::max(loan.since, m.last), 1e-6});
  const double rate = static_cast<double>(loan.samples) / taken;
  m.rate = m.rate > 0.0 ? m.rate + kNewRate * (rate - m.rate) : rate;
  m.last = at;
  m.samples += loan.samples;
}

std::vector<TileUnit> Loans::drop(std::uint32_t machine, std::uint32_t id) {
  machines_[machine].owed.erase(id);
  const Loan* loan = find(machine, id);
  if (loan == nullptr || loan->back) return {};
  std::vector<TileUnit> units = loan->units;
  end(id);
  return units;
}

void Loans::end(std::uint32_t id) {
  const auto at = loans_.find(id);
  if (at == loans_.end()) return;
  if (!at->second.back) --machines_[at->second.machine].held;
  loans_.erase(at);
}

template <typename Which>
std::vector<TileUnit> Loans::take(const Which& which) {
  std::vector<TileUnit> units;
  for (auto at = loans_.begin(); at != loans_.end();) {
    const Loan& loan = at->second;
    if (loan.back || !which(loan)) {
      ++at;
      continue;
    }
    ++takenBack_;
    --machines_[loan.machine].held;
    machines_[loan.machine].owed.insert(loan.id);
    units.insert(units.end(), loan.units.begin(), loan.units.end());
    at = loans_.erase(at);
  }
  return units;
}

std::vector<TileUnit> Loans::lose(std::uint32_t machine) {
  std::vector<TileUnit> units = take([&](const Loan& loan) { return loan.machine == machine; });
  machines_[machine].owed.clear();
  machines_[machine].rate = 0.0;
  return units;
}

std::vector<TileUnit> Loans::takeLate(double now, bool hurry) {
  const double times = hurry ? kHurryTimes : kTimes;
  const double more = hurry ? kHurrySeconds : kMoreSeconds;
  return take([&](const Loan& loan) {
    const double expected = loan.expected > 0.0 ? loan.expected : kUnknownSeconds / times;
    return now - loan.since > times * expected + more;
  });
}

void Loans::clear() {
  loans_.clear();
  for (Machine& m : machines_) {
    m.held = 0;
    m.owed.clear();
  }
}

}  // namespace trex::machines
