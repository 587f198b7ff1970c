// What was measured of a machine: its device graph and the times of its jobs, as text and as a
// picture.
#pragma once

#include <string>
#include <vector>

#include "src/schedule/graph.h"
#include "src/schedule/timing.h"

namespace trex::schedule {

struct MachineRecord {
  std::string name;  ///< for people
  Graph graph;
  std::vector<std::string> kinds;  ///< of jobs, of one amount each
  TimingModel timing{1, 1};        ///< a kind that a device does not do has no rates
  /// |predicted - measured| / measured, of jobs that the times were not fitted to.
  std::size_t jobs = 0;
  double medianError = 0.0, percentile90Error = 0.0;
};

/// JSON; recordOf() of it is the same record.
std::string textOf(const MachineRecord& record);
/// Reads text that may be hostile; `name` is for messages. Throws Error(kInput) that says what is
/// wrong where.
MachineRecord recordOf(const std::string& text, const std::string& name);
/// The graph as an SVG: memories, devices below the memory whose data they read, channels as arcs.
std::string graphSvg(const MachineRecord& record);
/// "1.23 M": numbers for people.
std::string withPrefix(double value);

}  // namespace trex::schedule
