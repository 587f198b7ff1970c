// Pictures of schedules.
#pragma once

#include <string>

#include "src/schedule/graph.h"
#include "src/schedule/schedule.h"

namespace trex::schedule {

/// An SVG with one row a device and one a channel, time to the right. What is too narrow to be seen
/// apart is drawn as one. A pure function.
std::string timelineSvg(const Graph& graph, const Schedule& schedule, const std::string& title);

}  // namespace trex::schedule
