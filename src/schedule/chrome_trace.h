// A schedule for trace viewers.
#pragma once

#include <functional>
#include <string>

#include "src/schedule/graph.h"
#include "src/schedule/schedule.h"

namespace trex::schedule {

/// What to call a job and an item: empty for their numbers.
struct Names {
  std::function<std::string(std::uint32_t)> job, item;
};

/// JSON in the Trace Event Format of Chrome and Perfetto: a thread a device, then one a channel, a
/// complete event a job and a transfer, in microseconds. A pure function.
std::string chromeTrace(const Graph& graph, const Schedule& schedule, const Names& names = {});

}  // namespace trex::schedule
