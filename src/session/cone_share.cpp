#include "src/session/cone_share.h"

#include <algorithm>

#include "src/schedule/offload.h"

namespace trex {
namespace {

/// What a cone's path costs the processors, and what a ray into cached light in its place costs
/// more, in rays as `trex doctor --measure` traces them: medians of what tests/bench/cone_share.py
/// prints.
constexpr double kRaysOfAPath = 10.0, kRaysOfAGather = 0.5;
constexpr double kConesAJob = 4096.0;  ///< of a tile's sample, about

/// Times of a kind of job on a device; none if they were not measured.
schedule::LinearTime timeOf(const schedule::MachineRecord& machine, std::uint32_t device,
                            const char* kind) {
  const auto at = std::find(machine.kinds.begin(), machine.kinds.end(), kind);
  if (at == machine.kinds.end()) return {};
  return machine.timing.at(device, static_cast<std::uint32_t>(at - machine.kinds.begin()));
}

schedule::LinearTime times(const schedule::LinearTime& time, double factor) {
  return {time.setup, {time.rates[0] * factor}};
}

}  // namespace

double autoConeShare(const schedule::MachineRecord* machine, const std::string& device,
                     bool sharesHostCores) {
  if (sharesHostCores) return 0.0;
  if (machine == nullptr) return 1.0;
  const auto& devices = machine->graph.devices;
  const auto at = std::find_if(devices.begin(), devices.end(),
                               [&](const schedule::Device& d) { return d.name == device; });
  if (at == devices.end() || at == devices.begin()) return 1.0;
  const schedule::LinearTime ray = timeOf(*machine, 0, "rays"),
                             cone =
                                 timeOf(*machine, static_cast<std::uint32_t>(at - devices.begin()),
                                        "cones");
  if (ray.rates.empty() || cone.rates.empty()) return 1.0;
  const std::uint32_t jobs = schedule::jobsForDevice(
      {times(ray, kRaysOfAPath), times(ray, kRaysOfAGather), cone, kConesAJob});
  return static_cast<double>(jobs) / schedule::kDealtJobs;
}

}  // namespace trex
