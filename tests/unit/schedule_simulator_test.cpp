// Played schedules: known makespans, what must hold of any, the bound, other kinds of jobs.
#include "src/schedule/simulate.h"

#include <gtest/gtest.h>

#include "src/core/error.h"
#include "src/schedule/bound.h"
#include "src/schedule/forecast.h"
#include "src/schedule/machines.h"
#include "src/schedule/planner.h"
#include "src/schedule/workloads.h"

namespace trex::schedule {
namespace {

const Planner mostWork = allPlanners()[0].plan, earliestStart = allPlanners()[1].plan,
              earliestFinish = allPlanners()[2].plan;

/// Disk to main memory at 1 byte a second, one device that takes a second a unit.
struct Small {
  Graph graph;
  TimingModel timing{1, kKinds};
  Workload workload;
  explicit Small(double capacity, std::vector<double> blocks) {
    graph.memories = {{"disk", kNever}, {"main", capacity}};
    graph.channels = {{"SATA", 1.0, 0.0, {{0, 1}}}};
    graph.devices = {{"CPU", 1, 1}};
    timing.set(0, kTraceRays, {0.0, {1.0}});
    for (double bytes : blocks) {
      workload.reads.push_back({static_cast<std::uint32_t>(workload.itemBytes.size())});
      workload.itemBytes.push_back(bytes);
      workload.scratch.push_back(0.0);
    }
  }
  void walk(std::vector<std::uint32_t> way, std::uint32_t parent = kNoWalk,
            std::uint32_t place = 0) {
    const auto first = static_cast<std::uint32_t>(workload.way.size());
    workload.way.insert(workload.way.end(), way.begin(), way.end());
    workload.walks.push_back(
        {first, static_cast<std::uint32_t>(way.size()), parent, place, kTraceRays});
  }
  SimulationResult play(Planner planner, Truth truth = {0.0, 0.0, 0.0, 1.0, 1}) const {
    SimulationInput in;
    in.graph = &graph;
    in.truth = in.assumed = &timing;
    in.workload = &workload;
    in.disturbance = truth;
    in.planner = planner;
    return simulate(in);
  }
};

TEST(ScheduleSimulator, KnownMakespans) {
  Small two(100.0, {10.0, 10.0});
  for (std::uint32_t i = 0; i < 20; ++i) two.walk({i % 2});
  for (Planner p : {mostWork, earliestStart, earliestFinish, planDmda}) {
    EXPECT_DOUBLE_EQ(two.play(p).makespan, 30.0);  // one load hides behind work
  }
  for (Planner p : {planRoundRobin, planLoadAnyOnce}) {
    EXPECT_DOUBLE_EQ(two.play(p).makespan, 40.0);  // nothing is brought ahead
  }
  Small onward(100.0, {10.0, 10.0});
  onward.walk({0, 1});
  for (const auto& [name, p, foresees] : allPlanners()) {
    // Ours bring the second block before anybody waits for it: else the channel is idle.
    EXPECT_DOUBLE_EQ(onward.play(p).makespan, foresees ? 21.0 : 22.0);
  }
  Small child(100.0, {10.0, 10.0});
  child.walk({0});
  child.walk({1}, 0, 0);  // new work, from a job
  for (const auto& [name, p, foresees] : allPlanners()) {
    EXPECT_DOUBLE_EQ(child.play(p).makespan, foresees ? 21.0 : 22.0);
  }
  Small nothing(100.0, {10.0});
  for (const auto& [name, p, foresees] : allPlanners()) EXPECT_EQ(nothing.play(p).makespan, 0.0);
}

TEST(ScheduleSimulator, RoomForOneBlock) {
  Small s(10.0, {10.0, 10.0});
  s.walk({0, 1, 0});
  for (const auto& [name, p, foresees] : allPlanners()) {
    const SimulationResult r = s.play(p);
    EXPECT_DOUBLE_EQ(r.makespan, 33.0);
    EXPECT_EQ(r.loads, 3u);
    EXPECT_EQ(problemOf(r.happened, s.graph, r.items, r.jobs), "");
  }
  EXPECT_DOUBLE_EQ(lowerBound(s.workload, s.graph, s.timing).bytes, 20.0);
}

TEST(ScheduleSimulator, BlockThatFitsNowhereIsRefused) {
  Small s(5.0, {10.0});
  s.walk({0});
  for (const auto& [name, p, foresees] : allPlanners()) EXPECT_THROW(s.play(p), Error);
}

RayWorkload smallRays(std::uint64_t seed) {
  RayWorkload of = seed % 2 ? boeing777(32, seed) : sponzaMuseum(32, seed);
  of.walks = 300;
  of.rays = 3e6;
  return of;
}

TEST(ScheduleSimulator, AnyScheduleHoldsAndNoneBeatsTheBound) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const Workload w = rayWorkload(smallRays(seed));
    for (const char* machines : {"A", "DR"}) {
      const Cluster c = clusterOf(machines);
      const Bound bound = lowerBound(w, c.graph, c.timing);
      for (const auto& [name, p, foresees] : allPlanners()) {
        SimulationInput in;
        in.graph = &c.graph;
        in.truth = in.assumed = &c.timing;
        in.workload = &w;
        in.disturbance.seed = seed;
        in.planner = p;
        const SimulationResult r = simulate(in);
        ASSERT_EQ(problemOf(r.happened, c.graph, r.items, r.jobs), "") << seed << machines;
        EXPECT_GE(r.makespan, bound.seconds());
        EXPECT_GE(r.loadedBytes * (1.0 + 1e-9), bound.bytes);  // sums in another order
        EXPECT_EQ(simulate(in).makespan, r.makespan);
      }
    }
  }
}

TEST(ScheduleSimulator, BeatsItsRivals) {
  // A smaller one of the instances that the bench prints.
  RayWorkload of = sponzaMuseum(64, 1);
  of.walks = 4000;
  const Workload w = rayWorkload(of);
  const Cluster c = clusterOf("R");
  const auto makespan = [&](Planner p) {
    SimulationInput in;
    in.graph = &c.graph;
    in.truth = in.assumed = &c.timing;
    in.workload = &w;
    in.planner = p;
    return simulate(in).makespan;
  };
  const double ours = makespan(mostWork);
  EXPECT_LE(ours, 0.60 * makespan(planRoundRobin));
  EXPECT_LE(ours, 0.90 * makespan(planLoadAnyOnce));
  EXPECT_LE(ours, 0.95 * makespan(planDmda));
}

TEST(ScheduleSimulator, OtherKindsOfJobs) {
  const Cluster c = clusterOf("AR");
  for (const Workload& w : {proximityWorkload(12, 20e9, 1), particleWorkload(24, 12e9, 1)}) {
    const Bound bound = lowerBound(w, c.graph, c.timing);
    for (const auto& [name, p, foresees] : allPlanners()) {
      SimulationInput in;
      in.graph = &c.graph;
      in.truth = in.assumed = &c.timing;
      in.workload = &w;
      in.planner = p;
      const SimulationResult r = simulate(in);
      EXPECT_EQ(problemOf(r.happened, c.graph, r.items, r.jobs), "");
      EXPECT_GE(r.makespan, bound.seconds());
    }
  }
}

TEST(ScheduleForecast, RatesTimesQueues) {
  Forecast f(3);
  const std::vector<double> queued{10.0, 0.0, 0.0};
  EXPECT_EQ(f.coming(queued, 2), std::vector<double>(3, 0.0));  // nothing is known
  f.served(0, 100.0);
  f.moved(0, 1, 50.0);
  f.served(1, 10.0);
  f.moved(1, 2, 20.0);  // one becomes two
  EXPECT_DOUBLE_EQ(f.rate(0, 1), 0.5);
  EXPECT_EQ(f.coming(queued, 1), (std::vector<double>{0.0, 5.0, 0.0}));
  EXPECT_EQ(f.coming(queued, 2), (std::vector<double>{0.0, 5.0, 10.0}));
  const std::vector<char> open{1, 0, 1};
  EXPECT_EQ(f.coming(queued, 2, open), (std::vector<double>{0.0, 5.0, 0.0}));
}

TEST(ScheduleForecast, WhatGoesThereComesBackInPart) {
  Forecast f(3, 0.1);
  f.served(0, 100.0);
  f.moved(0, 1, 50.0);
  // Nothing was served at 1 yet: what came there goes on as a whole, to where it came from.
  EXPECT_DOUBLE_EQ(f.rate(1, 0), 0.8);
  EXPECT_DOUBLE_EQ(f.rate(0, 1), 0.5);
  f.served(1, 93.75);
  f.moved(1, 2, 80.0);
  EXPECT_DOUBLE_EQ(f.rate(1, 0), 0.05);  // what is measured outweighs it
  EXPECT_DOUBLE_EQ(f.rate(1, 2), 0.8);
}

}  // namespace
}  // namespace trex::schedule
