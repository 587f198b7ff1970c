#include "src/schedule/state.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "src/core/error.h"

namespace trex::schedule {
namespace {

bool reaches(const State& s, const Item& item, const Device& d) {
  if (item.bytes <= 0.0) return true;
  const std::uint32_t target = item.moves ? d.host : d.memory;
  if (!item.moves && item.bytes > s.graph->memories[target].capacity) return false;
  for (std::uint64_t rest = item.copies; rest != 0; rest &= rest - 1) {
    const auto from = static_cast<std::uint32_t>(std::countr_zero(rest));
    if (std::isfinite(s.routes->seconds(from, target, item.bytes))) return true;
  }
  return std::any_of(s.moving.begin(), s.moving.end(),
                     [&](const Fetch& f) { return &s.items[f.item] == &item; });
}

void checkItem(const State& s, std::size_t i) {
  const Item& item = s.items[i];
  if (!isAmount(item.bytes)) {
    fail(ExitCode::kInput, "schedule, item {}: {} bytes", i, item.bytes);
  }
  const std::size_t memories = s.graph->memories.size();
  if (memories < 64 && item.copies >> memories != 0) {
    fail(ExitCode::kInput, "schedule, item {}: a copy in a memory that does not exist", i);
  }
}

void checkJob(const State& s, std::size_t j) {
  const Job& job = s.jobs[j];
  if (job.kind >= s.timing->kinds()) {
    fail(ExitCode::kInput, "schedule, job {}: kind {} of {}", j, job.kind, s.timing->kinds());
  }
  if (!std::all_of(job.amounts.begin(), job.amounts.end(), isAmount) || !isAmount(job.worth) ||
      !isAmount(job.scratch)) {
    fail(ExitCode::kInput, "schedule, job {}: a value is not finite and at least 0", j);
  }
  for (std::uint32_t item : job.reads) {
    if (item >= s.items.size()) fail(ExitCode::kInput, "schedule, job {}: item {}", j, item);
  }
  const auto& devices = s.graph->devices;
  const bool possible = std::any_of(devices.begin(), devices.end(), [&](const Device& d) {
    const auto number = static_cast<std::uint32_t>(&d - devices.data());
    return !s.timing->at(number, job.kind).rates.empty() &&
           std::all_of(job.reads.begin(), job.reads.end(),
                       [&](std::uint32_t item) { return reaches(s, s.items[item], d); });
  });
  const bool work =
      std::any_of(job.amounts.begin(), job.amounts.end(), [](double a) { return a > 0; });
  if (work && !possible) {
    fail(ExitCode::kInput,
         "schedule, job {}: no device can do it: its kind has no rates there, or an item that it "
         "reads has no copy, no channel leads there, or the memory is too small",
         j);
  }
}

}  // namespace

void checkState(const State& state) {
  checkGraph(*state.graph);
  if (state.timing->devices() != state.graph->devices.size()) {
    fail(ExitCode::kInput, "schedule: a timing model of {} devices, a graph of {}",
         state.timing->devices(), state.graph->devices.size());
  }
  for (std::size_t i = 0; i < state.items.size(); ++i) checkItem(state, i);
  for (std::size_t j = 0; j < state.jobs.size(); ++j) checkJob(state, j);
}

}  // namespace trex::schedule
