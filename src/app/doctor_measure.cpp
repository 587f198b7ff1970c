#include "src/app/doctor_measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "src/bench/measure_machine.h"
#include "src/command/kept_record.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/memory.h"

namespace trex {
namespace fs = std::filesystem;

schedule::MachineRecord measureAndKeep(const fs::path& picture) {
  const fs::path path = machineRecordPath();
  if (path.empty()) {
    fail(ExitCode::kOutput, "there is no home to keep the record in: set XDG_STATE_HOME");
  }
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error) fail(ExitCode::kOutput, "{}: {}", path.parent_path().string(), error.message());
  checkWritable(path);
  if (!picture.empty()) checkWritable(picture);
  writeTextAtomically(path, textOf(measureMachine()));
  const schedule::MachineRecord kept = *keptMachineRecord();
  if (!picture.empty()) writeTextAtomically(picture, graphSvg(kept));
  return kept;
}

void printRecord(const schedule::MachineRecord& r) {
  const schedule::Graph& g = r.graph;
  fmt::print("measured: {}\n", r.name);
  for (const schedule::Channel& c : g.channels) {
    for (const schedule::Link& link : c.links) {
      fmt::print("  {}: {} to {}, {}B/s, {:.3g} ms a transfer\n", c.name,
                 g.memories[link.from].name, g.memories[link.to].name,
                 schedule::withPrefix(c.bandwidth), 1e3 * c.latency);
    }
  }
  for (std::uint32_t d = 0; d < g.devices.size(); ++d) {
    const schedule::Memory& memory = g.memories[g.devices[d].memory];
    fmt::print("  {}: reads {}{}\n", g.devices[d].name, memory.name,
               std::isfinite(memory.capacity)
                   ? ", " + formatBytes(static_cast<std::uint64_t>(memory.capacity))
                   : "");
    for (std::uint32_t k = 0; k < r.kinds.size(); ++k) {
      const schedule::LinearTime& t = r.timing.at(d, k);
      if (t.rates.empty()) continue;
      fmt::print("    {}: {}/s, {:.3g} ms a job\n", r.kinds[k],
                 schedule::withPrefix(1.0 / std::max(t.rates[0], 1e-30)), 1e3 * t.setup);
    }
  }
  fmt::print(
      "  {} jobs that were not fitted are told with a median error of {:.0f} %, 90th percentile "
      "{:.0f} %\n",
      r.jobs, 100.0 * r.medianError, 100.0 * r.percentile90Error);
}

}  // namespace trex
