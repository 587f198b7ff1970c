#include "src/paths/gather_plan.h"

#include <algorithm>

#include "src/core/clock.h"
#include "src/schedule/planner.h"

namespace trex {
namespace {

constexpr double kFirstCones = 1e6;  // a second, until some were measured

}  // namespace

GatherPlan::GatherPlan(TrafficRecord& record) : record_(record) {
  graph_.memories = {{"memory"}};
  graph_.devices = {{"cones", 0, 0}};
  timing_.set(0, 0, {0.0, {1.0 / kFirstCones}});
}

void GatherPlan::begin(std::size_t cones) {
  cones_ = static_cast<double>(cones);
  begun_ = secondsNow();
  const schedule::Routes routes(graph_, 1.0);
  schedule::State s;
  s.graph = &graph_;
  s.routes = &routes;
  s.timing = &timing_;
  s.now = begun_;
  s.jobs = {{0, {}, {cones_}, cones_, 0.0, begun_}};
  for (const schedule::Run& run : schedule::plan(s, {}).runs)
    record_.plannedGather(run.start, run.end);
}

void GatherPlan::end() {
  const double now = secondsNow();
  record_.gathered(begun_, now);
  if (!(now > begun_)) return;
  if (samples_.size() == kSamples) samples_.erase(samples_.begin());
  samples_.push_back({{cones_}, now - begun_});
  timing_.set(0, 0, schedule::fitLinear(samples_));
}

}  // namespace trex
