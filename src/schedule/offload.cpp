#include "src/schedule/offload.h"

#include <algorithm>

#include "src/schedule/planner.h"

namespace trex::schedule {
namespace {

enum : std::uint32_t { kProcessors, kDevice };
enum : std::uint32_t { kKept, kDealt };
constexpr double kFirst = 1e12;  ///< worth of what can't be given away: it is planned first

}  // namespace

std::uint32_t jobsForDevice(const Offload& work) {
  Graph graph;
  graph.memories = {{"memory"}};
  graph.devices = {{"processors", 0, 0}, {"device", 0, 0}};
  TimingModel timing(2, 2);
  timing.set(kProcessors, kKept, work.kept);
  timing.set(kProcessors, kDealt, work.here);
  timing.set(kDevice, kDealt, work.there);
  const Routes routes(graph, 1.0);
  State s;
  s.graph = &graph;
  s.routes = &routes;
  s.timing = &timing;
  s.horizon = kNever;
  for (std::uint32_t i = 0; i < kDealtJobs; ++i) {
    s.jobs.push_back({kKept, {}, {work.units}, kFirst, 0.0, 0.0});
    s.jobs.push_back({kDealt, {}, {work.units}, 1.0, 0.0, 0.0});
  }
  const Schedule made = plan(s, {});
  return static_cast<std::uint32_t>(std::count_if(
      made.runs.begin(), made.runs.end(), [](const Run& r) { return r.device == kDevice; }));
}

}  // namespace trex::schedule
