// Plans: small ones whose best schedule is known, and what must hold of any.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>

#include "src/core/error.h"
#include "src/schedule/chrome_trace.h"
#include "src/schedule/machine_record.h"
#include "src/schedule/picture.h"
#include "src/schedule/planner.h"

namespace trex::schedule {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

const Planner mostWork = allPlanners()[0].plan, earliestStart = allPlanners()[1].plan,
              earliestFinish = allPlanners()[2].plan;
const Planner kWholePlans[] = {mostWork, earliestStart, earliestFinish, planDmda};

/// A graph with its model and state; not to be copied, since the state points to the others.
struct Setting {
  Graph graph;
  TimingModel timing{1, 1};
  std::unique_ptr<Routes> routes;
  State state;
  void finish() {
    routes = std::make_unique<Routes>(graph, 10.0);
    state.graph = &graph;
    state.routes = routes.get();
    state.timing = &timing;
    state.horizon = kNever;
  }
};

/// Disk to main memory at 1 byte a second, one device there that takes a second a unit.
std::unique_ptr<Setting> oneDevice(double capacity) {
  auto s = std::make_unique<Setting>();
  s->graph.memories = {{"disk", kNever}, {"main", capacity}};
  s->graph.channels = {{"SATA", 1.0, 0.0, {{0, 1}}}};
  s->graph.devices = {{"CPU", 1, 1}};
  s->timing.set(0, 0, {0.0, {1.0}});
  s->finish();
  return s;
}

void addBlock(State& s, double bytes, double units) {
  const auto item = static_cast<std::uint32_t>(s.items.size());
  s.items.push_back({bytes, 1u, false, units, 0.0});
  s.jobs.push_back({0, {item}, {units}, units, 0.0, 0.0});
}

std::string problem(const Schedule& plan, const State& s) {
  return problemOf(plan, *s.graph, s.items, s.jobs);
}

TEST(Schedule, LoadsOverlapWork) {
  auto s = oneDevice(100.0);
  addBlock(s->state, 10.0, 10.0);
  addBlock(s->state, 10.0, 10.0);
  checkState(s->state);
  // Load, then work and the other load at once, then work.
  for (Planner plan : kWholePlans) {
    const Schedule made = plan(s->state, {});
    EXPECT_DOUBLE_EQ(made.makespan(), 30.0);
    EXPECT_EQ(problem(made, s->state), "");
  }
}

TEST(Schedule, RoomForOneBlock) {
  auto s = oneDevice(10.0);
  addBlock(s->state, 10.0, 10.0);
  addBlock(s->state, 10.0, 10.0);
  // The second load has to wait for the first job's end.
  for (Planner plan : kWholePlans) {
    const Schedule made = plan(s->state, {});
    EXPECT_DOUBLE_EQ(made.makespan(), 40.0);
    EXPECT_EQ(problem(made, s->state), "");
  }
}

TEST(Schedule, WhatIsThereGoesFirst) {
  auto s = oneDevice(100.0);
  addBlock(s->state, 10.0, 10.0);
  addBlock(s->state, 10.0, 10.0);
  s->state.items[1].copies = 3u;
  for (Planner plan : {mostWork, earliestStart, earliestFinish}) {
    const Schedule made = plan(s->state, {});
    EXPECT_DOUBLE_EQ(made.makespan(), 20.0);  // the load hides behind the work
    EXPECT_EQ(made.runs.front().job, 1u);
  }
}

/// Two devices with memories of their own, the second behind a slow channel.
std::unique_ptr<Setting> slowChannel() {
  auto s = std::make_unique<Setting>();
  s->graph.memories = {{"disk", kNever}, {"main", 100.0}, {"device", 100.0}};
  s->graph.channels = {{"SATA", 10.0, 0.0, {{0, 1}}}, {"bus", 1.0, 0.0, {{1, 2}}}};
  s->graph.devices = {{"CPU", 1, 1}, {"GPU", 2, 1}};
  s->timing = TimingModel(2, 1);
  s->timing.set(0, 0, {0.0, {1.0}});
  s->timing.set(1, 0, {0.0, {0.1}});
  s->finish();
  return s;
}

TEST(Schedule, SlowChannelIsAvoidedWhileItDoesNotPay) {
  // 1 s to main memory; there 5 s of work, or 10 s of transfer and 0.5 s of work.
  auto s = slowChannel();
  addBlock(s->state, 10.0, 5.0);
  for (Planner plan : {mostWork, earliestFinish, planDmda}) {
    const Schedule made = plan(s->state, {});
    EXPECT_DOUBLE_EQ(made.makespan(), 6.0);
    EXPECT_EQ(made.runs[0].device, 0u);
  }
  // 50 s of work pay for the transfer.
  s->state.jobs[0].amounts = {50.0};
  for (Planner plan : {mostWork, earliestFinish, planDmda}) {
    const Schedule made = plan(s->state, {});
    EXPECT_DOUBLE_EQ(made.makespan(), 1.0 + 10.0 + 5.0);
    EXPECT_EQ(made.runs[0].device, 1u);
    EXPECT_EQ(problem(made, s->state), "");
  }
}

TEST(Schedule, WhatIsMissedLeastIsEvicted) {
  auto s = oneDevice(20.0);
  for (int i = 0; i < 3; ++i) addBlock(s->state, 10.0, 0.0);
  s->state.items[0].copies = s->state.items[1].copies = 3u;
  s->state.items[0].need = 5.0;
  s->state.items[1].need = 1.0;
  s->state.jobs[2].amounts = {1.0};
  s->state.jobs[2].worth = 1.0;
  const Schedule made = mostWork(s->state, {});
  ASSERT_EQ(made.fetches.size(), 1u);
  EXPECT_EQ(made.fetches[0].evicted, std::vector<std::uint32_t>{1});
  // A rival goes by what was used longest ago.
  s->state.items[1].lastUse = 7.0;
  EXPECT_EQ(planDmda(s->state, {}).fetches.at(0).evicted, std::vector<std::uint32_t>{0});
}

TEST(Schedule, ScratchNeedsRoom) {
  auto s = oneDevice(20.0);
  addBlock(s->state, 10.0, 10.0);
  addBlock(s->state, 10.0, 10.0);
  for (Job& job : s->state.jobs) job.scratch = 10.0;
  for (Planner plan : kWholePlans) {
    const Schedule made = plan(s->state, {});
    EXPECT_EQ(problem(made, s->state), "");
    EXPECT_EQ(made.runs.size(), 2u);
    EXPECT_DOUBLE_EQ(made.makespan(), 40.0);  // the second block has no room beside the results
  }
}

TEST(Schedule, RunningJobKeepsItsData) {
  auto s = oneDevice(10.0);
  addBlock(s->state, 10.0, 0.0);
  addBlock(s->state, 10.0, 1.0);
  s->state.items[0].copies = 3u;
  s->state.now = 100.0;
  s->state.running = {{0, 104.0, {0}, 0.0}};
  for (Planner plan : kWholePlans) {
    const Schedule made = plan(s->state, {});
    ASSERT_EQ(made.fetches.size(), 1u);
    EXPECT_DOUBLE_EQ(made.fetches[0].start, 104.0);
    EXPECT_DOUBLE_EQ(made.runs[0].start, 114.0);
  }
}

TEST(Schedule, EmptyWorkAndEmptyBlocks) {
  auto s = oneDevice(10.0);
  for (const auto& [name, plan, foresees] : allPlanners())
    EXPECT_TRUE(plan(s->state, {}).runs.empty());
  addBlock(s->state, 10.0, 0.0);
  for (const auto& [name, plan, foresees] : allPlanners())
    EXPECT_TRUE(plan(s->state, {}).runs.empty());
  addBlock(s->state, 0.0, 3.0);
  checkState(s->state);
  for (const auto& [name, plan, foresees] : allPlanners()) {
    const Schedule made = plan(s->state, {});
    EXPECT_TRUE(made.fetches.empty());
    EXPECT_DOUBLE_EQ(made.makespan(), 3.0);
  }
}

TEST(Schedule, HorizonLeavesTheRest) {
  auto s = oneDevice(1000.0);
  for (int i = 0; i < 20; ++i) addBlock(s->state, 10.0, 1.0);
  s->state.horizon = 25.0;
  EXPECT_EQ(earliestStart(s->state, {}).runs.size(), 3u);
  // Of what can only begin beyond it one is planned all the same.
  s->state.horizon = 0.0;
  EXPECT_EQ(earliestStart(s->state, {}).runs.size(), 1u);
}

TEST(Schedule, APlanIsKeptForAWhile) {
  auto s = oneDevice(1000.0);
  for (int i = 0; i < 3; ++i) addBlock(s->state, 10.0, 10.0);
  s->state.items[0].copies = s->state.items[1].copies = 3u;
  s->state.patience = 5.0;
  s->state.horizon = 100.0;
  s->state.jobs[1].worth = 5.0;
  Schedule before = mostWork(s->state, {});
  ASSERT_EQ(before.runs.size(), 3u);
  EXPECT_EQ(before.runs[0].job, 0u);
  EXPECT_EQ(before.whole, 0.0);
  // The first job runs and the load is under way; the order of the rest would be another by now.
  s->state.running = {{0, 10.0, {0}, 0.0}};
  s->state.moving = before.fetches;
  s->state.jobs[0].amounts = {0.0};
  before.runs.erase(before.runs.begin());
  s->state.now = 1.0;
  for (std::size_t j = 1; j < 3; ++j) s->state.jobs[j].worth = 1000.0 - s->state.jobs[j].worth;
  s->state.jobs[2].worth = 1e6;
  const Schedule kept = mostWork(s->state, before);
  EXPECT_EQ(kept.runs[0].job, before.runs[0].job);
  EXPECT_EQ(kept.whole, 0.0);
  s->state.now = 6.0;
  const Schedule anew = mostWork(s->state, before);
  EXPECT_EQ(anew.whole, 6.0);
  // Nothing is kept where the store's channel is idle, ...
  s->state.now = 1.0;
  s->state.moving.clear();
  s->state.items[2].copies = 3u;
  EXPECT_EQ(mostWork(s->state, before).whole, 1.0);
  // ... or where all stands still.
  before.feeding = 0;
  EXPECT_EQ(mostWork(s->state, before).whole, 0.0);
  s->state.running.clear();
  EXPECT_EQ(mostWork(s->state, before).whole, 1.0);
}

TEST(Schedule, AnIdleStoreBringsWhatIsNeededMost) {
  auto s = oneDevice(25.0);
  for (int i = 0; i < 4; ++i) addBlock(s->state, 10.0, 0.0);
  s->state.items[0].copies = 3u;
  for (std::uint32_t i = 0; i < 4; ++i) s->state.items[i].need = 1.0 + i % 3;
  EXPECT_TRUE(mostWork(s->state, {}).fetches.empty());  // nothing goes on that could need it
  s->state.jobs[0].amounts = {1.0};
  const Schedule made = mostWork(s->state, {});
  ASSERT_EQ(made.fetches.size(), 1u);
  EXPECT_EQ(made.fetches[0].item, 2u);
  EXPECT_TRUE(made.fetches[0].evicted.empty());
  EXPECT_EQ(problem(made, s->state), "");
  for (Item& item : s->state.items) item.need = 0.0;
  EXPECT_TRUE(mostWork(s->state, {}).fetches.empty());
  // Nothing goes for it.
  s->state.items[1].copies = 3u;
  s->state.items[2].need = 1.0;
  EXPECT_TRUE(mostWork(s->state, {}).fetches.empty());
}

TEST(Schedule, WorkGoesToWhereItsDataIs) {
  // Two machines with a disk each, joined by a link; the block is on the first one's memory. The
  // second would be done a little earlier if it loaded the block again.
  auto s = std::make_unique<Setting>();
  s->graph.memories = {
      {"disk 1", kNever}, {"main 1", 100.0}, {"disk 2", kNever}, {"main 2", 100.0}};
  s->graph.channels = {{"SATA 1", 1.0, 0.0, {{0, 1}}},
                       {"SATA 2", 1.0, 0.0, {{2, 3}}},
                       {"port 1", 0.5, 0.0, {{1, 3}}},
                       {"port 2", 1.0, 0.0, {{3, 1}}}};
  s->graph.devices = {{"CPU 1", 1, 1}, {"CPU 2", 3, 3}};
  s->timing = TimingModel(2, 1);
  s->timing.set(0, 0, {0.0, {1.0}});
  s->timing.set(1, 0, {0.0, {1.0}});
  s->finish();
  s->state.items.push_back({10.0, 0b0111, false, 1.0, 0.0});
  s->state.items.push_back({12.0, 0b1000, true, 0.0, 0.0});  // a queue on the second
  s->state.jobs.push_back({0, {0, 1}, {5.0}, 5.0, 0.0, 0.0});
  EXPECT_EQ(mostWork(s->state, {}).runs.at(0).device, 1u);  // disks have nothing else to do
  s->state.items.push_back({10.0, 0b0101, false, 9.0, 0.0});
  const Schedule made = mostWork(s->state, {});
  ASSERT_EQ(made.runs.size(), 1u);
  EXPECT_EQ(made.runs[0].device, 0u);
  EXPECT_EQ(earliestFinish(s->state, {}).runs.at(0).device, 1u);
}

TEST(Schedule, BadGraphsAreRefused) {
  const auto refused = [](const std::function<void(Graph&)>& change) {
    auto s = slowChannel();
    change(s->graph);
    EXPECT_THROW(checkGraph(s->graph), Error);
  };
  EXPECT_NO_THROW(checkGraph(slowChannel()->graph));
  for (double bad : {0.0, -1.0, kInf, std::nan("")}) {
    refused([&](Graph& g) { g.channels[0].bandwidth = bad; });
  }
  for (double bad : {-1.0, kInf, std::nan("")}) {
    refused([&](Graph& g) { g.channels[0].latency = bad; });
  }
  for (double bad : {0.0, -1.0, std::nan("")}) {
    refused([&](Graph& g) { g.memories[1].capacity = bad; });
  }
  refused([](Graph& g) { g.devices.clear(); });
  refused([](Graph& g) { g.devices[0].memory = 3; });
  refused([](Graph& g) { g.channels[0].links[0].to = 9; });
  refused([](Graph& g) { g.channels[1].name.clear(); });
  refused([](Graph& g) { g.memories.resize(65, {"more", 1.0}); });
}

TEST(Schedule, MemoryThatNothingReachesIsNamed) {
  auto s = slowChannel();
  s->graph.channels.pop_back();
  try {
    checkGraph(s->graph);
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
    EXPECT_NE(std::string(e.what()).find("memory device of device GPU"), std::string::npos);
  }
}

TEST(Schedule, JobThatNobodyCanDoIsNamed) {
  const auto refused = [](const std::function<void(State&)>& change) {
    auto s = oneDevice(10.0);
    addBlock(s->state, 5.0, 1.0);
    change(s->state);
    EXPECT_THROW(checkState(s->state), Error);
  };
  refused([](State& s) { s.items[0].copies = 0; });
  refused([](State& s) { s.items[0].bytes = 11.0; });
  refused([](State& s) { s.items[0].bytes = kInf; });
  refused([](State& s) { s.items[0].copies = 8; });
  refused([](State& s) { s.jobs[0].amounts = {std::nan("")}; });
  refused([](State& s) { s.jobs[0].kind = 1; });
  refused([](State& s) { s.jobs[0].reads = {7}; });
}

TEST(Schedule, CheapestPath) {
  // 0 -> 1 -> 2 is wider than 0 -> 2, which has less latency.
  Graph g;
  g.memories = {{"a", 1.0}, {"b", 1.0}, {"c", 1.0}};
  g.channels = {
      {"x", 100.0, 1.0, {{0, 1}}}, {"y", 100.0, 1.0, {{1, 2}}}, {"z", 10.0, 0.0, {{0, 2}}}};
  EXPECT_EQ(Routes(g, 1000.0).hops(0, 2).size(), 2u);
  EXPECT_DOUBLE_EQ(Routes(g, 1000.0).seconds(0, 2, 1000.0), 22.0);
  EXPECT_EQ(Routes(g, 1.0).hops(0, 2).size(), 1u);
  EXPECT_EQ(Routes(g, 1.0).seconds(2, 0, 1.0), kNever);
}

/// Any graph of a disk, two main memories and a device, with blocks of any size anywhere.
std::unique_ptr<Setting> randomSetting(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> u(0.0, 1.0);
  auto s = std::make_unique<Setting>();
  s->graph.memories = {{"disk", kNever},
                       {"main", 20 + 50 * u(random)},
                       {"device", 20 + 20 * u(random)},
                       {"other", 20 + 30 * u(random)}};
  s->graph.channels = {{"SATA", 1 + u(random), u(random), {{0, 1}}},
                       {"bus", 5 * (1 + u(random)), 0.1, {{1, 2}, {2, 1}}},
                       {"net", 1 + 5 * u(random), 0.5, {{1, 3}, {3, 1}}}};
  s->graph.devices = {{"CPU", 1, 1}, {"GPU", 2, 1}, {"far CPU", 3, 3}};
  s->timing = TimingModel(3, 2);
  for (std::uint32_t d = 0; d < 3; ++d) {
    for (std::uint32_t k = 0; k < 2; ++k) s->timing.set(d, k, {u(random), {0.1 + u(random)}});
  }
  const int blocks = 3 + static_cast<int>(20 * u(random));
  for (int i = 0; i < blocks; ++i) {
    addBlock(s->state, 9.0 * u(random), u(random) < 0.8 ? 20.0 * u(random) : 0.0);
    Job& job = s->state.jobs.back();
    job.kind = u(random) < 0.5 ? 0 : 1;
    job.scratch = u(random) < 0.2 ? 2.0 : 0.0;
    if (i > 0 && u(random) < 0.3) job.reads.push_back(static_cast<std::uint32_t>(i - 1));
    if (u(random) < 0.3) {
      s->state.items.push_back({u(random), 2u, true, 0.0, 0.0});  // a queue in main memory
      job.reads.push_back(static_cast<std::uint32_t>(s->state.items.size()) - 1);
      addBlock(s->state, 1.0, 0.0);
    }
  }
  s->finish();
  return s;
}

TEST(Schedule, AnyPlanHolds) {
  for (std::uint32_t seed = 1; seed <= 200; ++seed) {
    auto s = randomSetting(seed);
    checkState(s->state);
    for (const auto& [name, plan, foresees] : allPlanners()) {
      const Schedule made = plan(s->state, {});
      ASSERT_EQ(problem(made, s->state), "") << "seed " << seed;
      std::vector<int> times(s->state.jobs.size(), 0);
      for (const schedule::Run& r : made.runs) ++times[r.job];
      for (std::size_t j = 0; j < times.size(); ++j) {
        EXPECT_LE(times[j], s->state.jobs[j].amounts[0] > 0.0 ? 1 : 0);
      }
      const Schedule again = plan(s->state, {});
      ASSERT_EQ(again.runs.size(), made.runs.size());
      for (std::size_t i = 0; i < made.runs.size(); ++i) {
        EXPECT_EQ(again.runs[i].job, made.runs[i].job);
        EXPECT_EQ(again.runs[i].device, made.runs[i].device);
        EXPECT_EQ(again.runs[i].start, made.runs[i].start);
      }
    }
  }
}

TEST(Schedule, WholePlansServeEveryJob) {
  for (std::uint32_t seed = 1; seed <= 100; ++seed) {
    auto s = randomSetting(seed);
    std::size_t jobs = 0;
    for (const Job& job : s->state.jobs) jobs += job.amounts[0] > 0.0;
    for (Planner plan : kWholePlans) EXPECT_EQ(plan(s->state, {}).runs.size(), jobs) << seed;
  }
}

TEST(ScheduleValidator, FindsEachFault) {
  auto s = oneDevice(15.0);
  addBlock(s->state, 10.0, 10.0);
  addBlock(s->state, 10.0, 10.0);
  const Schedule good = mostWork(s->state, {});
  ASSERT_EQ(problem(good, s->state), "");
  const auto found = [&](const std::function<void(Schedule&)>& change) {
    Schedule bad = good;
    change(bad);
    EXPECT_NE(problem(bad, s->state), "");
  };
  found([](Schedule& b) { b.runs[0].start -= 1.0; });             // before its block is there
  found([](Schedule& b) { b.runs[1].start = b.runs[0].start; });  // two at once
  found([](Schedule& b) { b.fetches[1].start = b.fetches[0].start; });
  found([](Schedule& b) { b.fetches[1].evicted.clear(); });  // no room
  found([](Schedule& b) { b.fetches[1].evicted[0] = 1; });   // not there
  found([](Schedule& b) { b.fetches.erase(b.fetches.begin()); });
  found([](Schedule& b) { b.fetches[0].from = 1; });  // no such link
  found([](Schedule& b) { b.runs[0].end = kInf; });
  found([](Schedule& b) { b.runs[0].end = b.runs[0].start - 1.0; });
  found([](Schedule& b) { b.runs[0].end = 40.0; });  // its block is evicted meanwhile
}

TEST(Schedule, KindWithoutRatesIsNotDone) {
  auto s = slowChannel();
  s->timing = TimingModel(2, 1);
  s->timing.set(1, 0, {0.0, {1.0}});
  addBlock(s->state, 10.0, 1.0);  // quicker by the first device, if it could
  for (const auto& [name, plan, foresees] : allPlanners()) {
    const Schedule made = plan(s->state, {});
    for (const schedule::Run& r : made.runs) EXPECT_EQ(r.device, 1u) << name;
  }
  s->timing = TimingModel(2, 1);
  EXPECT_THROW(checkState(s->state), Error);
}

MachineRecord someRecord() {
  MachineRecord r;
  r.name = "a <machine>";
  r.graph = slowChannel()->graph;
  r.kinds = {"trace", "gather"};
  r.timing = TimingModel(2, 2);
  r.timing.set(0, 0, {1e-3, {1e-7}});
  r.timing.set(1, 1, {2e-3, {3e-8}});
  r.jobs = 12;
  r.medianError = 0.1;
  r.percentile90Error = 0.3;
  return r;
}

TEST(ScheduleMachineRecord, IsReadAsItWasWritten) {
  const std::string text = textOf(someRecord());
  const MachineRecord r = recordOf(text, "machine.json");
  EXPECT_EQ(textOf(r), text);
  EXPECT_EQ(r.graph.memories[0].capacity, kNever);
  EXPECT_EQ(r.graph.channels[1].links[0].to, 2u);
  EXPECT_TRUE(r.timing.at(0, 1).rates.empty());
  EXPECT_DOUBLE_EQ(r.timing.at(1, 1).rates.at(0), 3e-8);
  EXPECT_NE(graphSvg(r).find("a &lt;machine&gt;"), std::string::npos);
}

TEST(ScheduleMachineRecord, HostileTextIsRefused) {
  const std::string good = textOf(someRecord());
  for (std::size_t length = 0; length + 2 < good.size(); length += 7) {
    EXPECT_THROW(recordOf(good.substr(0, length), "x"), Error) << length;
  }
  const auto refused = [&](const std::string& pointer, const nlohmann::json& value) {
    nlohmann::json changed = nlohmann::json::parse(good);
    changed[nlohmann::json::json_pointer(pointer)] = value;
    EXPECT_THROW(recordOf(changed.dump(), "x"), Error) << pointer;
  };
  refused("/trex", 2);
  refused("/more", 1);
  refused("/kinds", nlohmann::json::array());
  refused("/kinds/0", 7);
  refused("/memories/1/capacity_bytes", 0);
  refused("/memories/1/capacity_bytes", "large");
  refused("/channels/0/bandwidth_bytes_per_second", 0);
  refused("/channels/0/bandwidth_bytes_per_second", -1);
  refused("/channels/0/latency_seconds", nullptr);
  refused("/channels/0/links/0/to", 3);
  refused("/channels/0/links", nlohmann::json(std::vector<int>(100, 0)));
  refused("/channels", nlohmann::json::array());
  refused("/devices", nlohmann::json::array());
  refused("/devices/0/memory", -1);
  refused("/devices/0/times/trace/seconds_per_unit", -1);
  refused("/devices/0/times/trace", 5);
  refused("/errors", nlohmann::json::object());
}

TEST(SchedulePicture, TraceAndTimelines) {
  auto s = slowChannel();
  s->graph.devices[1].name = "GPU <\"&\xff";
  addBlock(s->state, 10.0, 50.0);
  const Schedule made = mostWork(s->state, {});
  const auto trace = nlohmann::json::parse(
      chromeTrace(s->graph, made, {[](std::uint32_t) { return "trace"; }, nullptr}));
  const auto& events = trace.at("traceEvents");
  ASSERT_EQ(events.size(), 4u + 1u + 2u);  // rows, a job, two transfers
  EXPECT_EQ(events[4].at("name"), "trace");
  EXPECT_EQ(events[4].at("tid"), 1);
  EXPECT_DOUBLE_EQ(events[4].at("ts").get<double>(), 11e6);
  EXPECT_DOUBLE_EQ(events[4].at("dur").get<double>(), 5e6);
  EXPECT_EQ(events[6].at("name"), "item 0");
  EXPECT_EQ(events[6].at("args").at("to"), "device");
  const std::string picture = timelineSvg(s->graph, made, "a < b");
  EXPECT_NE(picture.find("GPU &lt;&quot;&amp;"), std::string::npos);
  EXPECT_NE(picture.find("a &lt; b"), std::string::npos);
  EXPECT_NE(timelineSvg(s->graph, {}, "empty").find("</svg>"), std::string::npos);
}

}  // namespace
}  // namespace trex::schedule
