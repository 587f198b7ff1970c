// trex bench schedule: our scheduler against its rivals and a bound, on machines that are not
// there.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "src/bench/bench.h"
#include "src/bench/bench_schedule_live.h"
#include "src/bench/median.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/schedule/bound.h"
#include "src/schedule/chrome_trace.h"
#include "src/schedule/machines.h"
#include "src/schedule/picture.h"
#include "src/schedule/random.h"
#include "src/schedule/simulate.h"
#include "src/schedule/workloads.h"

namespace trex {
namespace schedule {
namespace {

using Json = nlohmann::ordered_json;

struct ScheduleArguments {
  std::vector<std::string> machines = {"A", "B", "C", "D", "R", "AR", "CD", "RRRR", "ABCD"};
  std::vector<std::string> models = {"boeing", "sponza"};
  std::string json, picture, trace;
  int seeds = 5;
  bool sameEviction = false;
  LiveArguments live;
};

struct Model {
  const char* name;
  const char* title;
  std::uint32_t blocks;
  Workload (*make)(std::uint64_t seed);
};
constexpr Model kModels[] = {
    {"boeing", "Boeing 777", 128, [](std::uint64_t s) { return rayWorkload(boeing777(128, s)); }},
    {"sponza", "Sponza", 64, [](std::uint64_t s) { return rayWorkload(sponzaMuseum(64, s)); }},
    {"proximity", "proximity", 144,
     [](std::uint64_t s) { return proximityWorkload(24, 26.5e9, s); }},
    {"particles", "particles", 64, [](std::uint64_t s) { return particleWorkload(64, 26.5e9, s); }},
};

const Model& modelNamed(const std::string& name) {
  for (const Model& m : kModels) {
    if (name == m.name) return m;
  }
  fail(ExitCode::kUsage, "--model {}: want boeing, sponza, proximity or particles", name);
}

/// What a test run would find: jobs of all sizes, disturbed as all are, and a line fitted to them.
TimingModel fitted(const TimingModel& truth, const Truth& disturbance) {
  constexpr int kJobs = 30;
  Random random(disturbance.seed + 1000);
  TimingModel out(truth.devices(), truth.kinds());
  for (std::uint32_t d = 0; d < truth.devices(); ++d) {
    for (std::uint32_t k = 0; k < truth.kinds(); ++k) {
      std::vector<TimingSample> samples;
      for (int i = 0; i < kJobs; ++i) {
        const std::vector<double> amounts{std::pow(10.0, 3.0 + 3.3 * random())};
        double seconds = truth.at(d, k).seconds(amounts) *
                         (1.0 + disturbance.jobNoise * std::abs(random.normal()));
        if (random() < disturbance.overrunShare) seconds *= disturbance.overrunFactor;
        samples.push_back({amounts, seconds});
      }
      out.set(d, k, fitLinear(samples));
    }
  }
  return out;
}

/// Seconds of the processor that this thread has had: other programs do not count.
double threadSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// One cluster, one workload, one seed: all planners.
struct Instance {
  double bound = 0.0;
  std::vector<SimulationResult> results;  ///< of allPlanners()
  std::vector<double> plannedShare;       ///< seconds of planning by simulated ones
};

/// The planner that this thread plays, and the seconds that it has taken.
thread_local Planner played = nullptr;
thread_local double planningSeconds = 0.0;

Schedule timedPlan(const State& state, const Schedule& previous) {
  const double start = threadSeconds();
  Schedule made = played(state, previous);
  planningSeconds += threadSeconds() - start;
  return made;
}

Instance play(const ScheduleArguments& a, const Cluster& cluster, const Model& model,
              std::uint64_t seed, bool keep) {
  const Workload workload = model.make(seed);
  SimulationInput in;
  in.graph = &cluster.graph;
  in.truth = &cluster.timing;
  in.workload = &workload;
  in.disturbance.seed = seed;
  const TimingModel assumed = fitted(cluster.timing, in.disturbance);
  in.assumed = &assumed;
  Instance out;
  out.bound = lowerBound(workload, cluster.graph, cluster.timing).seconds();
  for (const NamedPlanner& p : allPlanners()) {
    played = p.plan;
    in.planner = timedPlan;
    in.forecast = p.foresees || a.sameEviction;
    if (a.sameEviction) in.rivalsEvict = Evict::kNeededLatest;
    planningSeconds = 0.0;
    out.results.push_back(simulate(in));
    SimulationResult& r = out.results.back();
    out.plannedShare.push_back(planningSeconds / r.makespan);
    const std::string problem = problemOf(r.happened, cluster.graph, r.items, r.jobs);
    if (!problem.empty()) fail(ExitCode::kFailed, "{}: {}", p.name, problem);
    if (!keep || out.results.size() > 1) r.happened = {};
    r.items.clear();
    r.jobs.clear();
  }
  return out;
}

double geometricMean(const std::vector<double>& values) {
  double sum = 0.0;
  for (double v : values) sum += std::log(v);
  return values.empty() ? 1.0 : std::exp(sum / static_cast<double>(values.size()));
}

/// Our makespan over another's, of all seeds.
std::vector<double> ratios(const std::vector<Instance>& seeds, std::size_t planner) {
  std::vector<double> out;
  for (const Instance& i : seeds) {
    out.push_back(i.results[0].makespan / i.results[planner].makespan);
  }
  return out;
}

/// All seeds of a cluster and a model; their ratios are added to those of all rows.
Json rowOf(const std::string& machines, const Model& model, const std::vector<Instance>& seeds,
           std::map<std::string, std::vector<double>>& all) {
  const auto mean = [&](auto value) {
    std::vector<double> values;
    for (const Instance& i : seeds) values.push_back(value(i));
    return geometricMean(values);
  };
  Json row = {{"machines", machines}, {"model", model.title}, {"blocks", model.blocks}};
  row["bound_seconds"] = mean([](const Instance& i) { return i.bound; });
  row["makespan_seconds"] = mean([](const Instance& i) { return i.results[0].makespan; });
  std::vector<double> overBound;
  for (const Instance& i : seeds) overBound.push_back(i.results[0].makespan / i.bound);
  row["of_bound"] = geometricMean(overBound);
  all["bound"].insert(all["bound"].end(), overBound.begin(), overBound.end());
  for (std::size_t p = 0; p < allPlanners().size(); ++p) {
    const std::string name = allPlanners()[p].name;
    row["loads"][name] = mean([&](const Instance& i) {
      return static_cast<double>(std::max<std::uint64_t>(1, i.results[p].loads));
    });
    row["idle_share"][name] = 1.0 - mean([&](const Instance& i) { return i.results[p].busyShare; });
    if (p == 0) continue;
    const std::vector<double> r = ratios(seeds, p);
    row["of"][name] = geometricMean(r);
    row["worst_of"][name] = *std::max_element(r.begin(), r.end());
    all[name].insert(all[name].end(), r.begin(), r.end());
  }
  row["plan_core_share"] = mean([](const Instance& i) { return i.plannedShare[0]; });
  return row;
}

/// Seconds of one plan for four machines and 256 blocks, rays for each of them everywhere: the
/// median, and the most, of 101.
Json planningTime() {
  constexpr std::uint32_t kBlocks = 256;
  const Cluster c = clusterOf("ABCD");
  const Routes routes(c.graph, 1e8);
  State s;
  s.graph = &c.graph;
  s.routes = &routes;
  s.timing = &c.timing;
  s.horizon = SimulationInput{}.horizon;
  std::vector<double> seconds;
  for (std::uint64_t seed = 1; seed <= 101; ++seed) {
    Random random(seed);
    s.items.clear();
    s.jobs.clear();
    for (std::uint32_t b = 0; b < kBlocks; ++b) {
      Item item{26.5e9 / kBlocks, 0, false, random(), random()};
      for (std::uint32_t m = 0; m < 4; ++m) item.copies |= std::uint64_t{1} << 3 * m;
      if (b < 200) item.copies |= std::uint64_t{1} << (3 * (b % 4) + 1);  // main memories are full
      if (b < 160) item.copies |= std::uint64_t{1} << (3 * (b / 40) + 2);
      s.items.push_back(item);
      s.jobs.push_back({kTraceRays, {b}, {1e5 * random()}, 1e5 * random(), 0.0, 0.0});
    }
    for (std::uint32_t b = 0; b < kBlocks; ++b) {
      for (std::uint32_t m = 0; m < 4; ++m) {
        s.jobs[b].reads.push_back(static_cast<std::uint32_t>(s.items.size()));
        s.items.push_back(
            {48.0 * 25e3 * random(), std::uint64_t{1} << (3 * m + 1), true, 0.0, 0.0});
      }
    }
    const double start = threadSeconds();
    const Schedule made = allPlanners()[0].plan(s, {});
    seconds.push_back(threadSeconds() - start);
    if (made.runs.empty()) fail(ExitCode::kFailed, "the plan that was timed is empty");
  }
  return {{"median_seconds", median(seconds)},
          {"most_seconds", *std::max_element(seconds.begin(), seconds.end())}};
}

Json timingErrors(std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  const auto at = [&](double share) {
    return errors.empty()
               ? 0.0
               : errors[static_cast<std::size_t>(share * static_cast<double>(errors.size() - 1))];
  };
  return {{"jobs", errors.size()}, {"median", at(0.5)}, {"percentile_90", at(0.9)}};
}

void writePictures(const ScheduleArguments& a, const Cluster& cluster, const Model& model,
                   const SimulationResult& result) {
  if (!a.picture.empty()) {
    writeTextAtomically(a.picture,
                        timelineSvg(cluster.graph, result.happened,
                                    fmt::format("{} in {} blocks on {}: {:.1f} s", model.title,
                                                model.blocks, cluster.name, result.makespan)));
  }
  if (!a.trace.empty()) writeTextAtomically(a.trace, chromeTrace(cluster.graph, result.happened));
}

Json measure(const ScheduleArguments& a) {
  Json document = {{"bench", "schedule"}, {"seeds", a.seeds}, {"same_eviction", a.sameEviction}};
  document["rows"] = Json::array();
  std::map<std::string, std::vector<double>> all;
  std::vector<double> errors;
  bool first = true;
  for (const std::string& machines : a.machines) {
    const Cluster cluster = clusterOf(machines);
    for (const std::string& name : a.models) {
      const Model& model = modelNamed(name);
      std::vector<Instance> seeds(static_cast<std::size_t>(a.seeds));
      tbb::parallel_for(std::size_t{0}, seeds.size(), [&](std::size_t i) {
        seeds[i] = play(a, cluster, model, i + 1, first && i == 0);
      });
      if (first) writePictures(a, cluster, model, seeds[0].results[0]);
      first = false;
      for (const Instance& i : seeds) {
        const std::vector<double>& e = i.results[0].timingErrors;
        errors.insert(errors.end(), e.begin(), e.end());
      }
      document["rows"].push_back(rowOf(machines, model, seeds, all));
    }
  }
  for (const auto& [name, values] : all) {
    document["geometric_mean"][name] = geometricMean(values);
    document["worst"][name] = *std::max_element(values.begin(), values.end());
  }
  document["planning"] = planningTime();
  document["timing_errors"] = timingErrors(std::move(errors));
  return document;
}

void printTable(const Json& d) {
  fmt::print("{:<8} {:<11} {:>6} {:>9} {:>8}", "machines", "model", "blocks", "makespan",
             "of bound");
  for (std::size_t p = 1; p < allPlanners().size(); ++p) {
    fmt::print(" {:>15}", fmt::format("of {}", allPlanners()[p].name));
  }
  fmt::print(" {:>13} {:>6}\n", "worst of dmda", "core");
  for (const Json& row : d["rows"]) {
    fmt::print("{:<8} {:<11} {:>6} {:>7.1f} s {:>8.2f}", row["machines"].get<std::string>(),
               row["model"].get<std::string>(), row["blocks"].get<int>(),
               row["makespan_seconds"].get<double>(), row["of_bound"].get<double>());
    for (std::size_t p = 1; p < allPlanners().size(); ++p) {
      fmt::print(" {:>15.2f}", row["of"][allPlanners()[p].name].get<double>());
    }
    fmt::print(" {:>13.2f} {:>4.1f} %\n", row["worst_of"]["dmda"].get<double>(),
               100.0 * row["plan_core_share"].get<double>());
  }
  for (const char* what : {"geometric_mean", "worst"}) {
    fmt::print("{:<37} {:>8.2f}", what[0] == 'g' ? "geometric mean" : "worst instance",
               d[what]["bound"].get<double>());
    for (std::size_t p = 1; p < allPlanners().size(); ++p) {
      fmt::print(" {:>15.2f}", d[what][allPlanners()[p].name].get<double>());
    }
    fmt::print("\n");
  }
  fmt::print("a plan for 4 machines and 256 blocks: {:.2f} ms, at most {:.2f} ms\n",
             1e3 * d["planning"]["median_seconds"].get<double>(),
             1e3 * d["planning"]["most_seconds"].get<double>());
  fmt::print(
      "timing model, {} jobs it was not fitted to: median error {:.1f} %, 90th percentile {:.1f} "
      "%\n",
      d["timing_errors"]["jobs"].get<std::size_t>(),
      100.0 * d["timing_errors"]["median"].get<double>(),
      100.0 * d["timing_errors"]["percentile_90"].get<double>());
}

void writeOut(const Json& document, const std::string& file, void (*print)(const Json&)) {
  if (file == "-") {
    fmt::print("{}\n", document.dump(1));
  } else {
    if (!file.empty()) writeTextAtomically(file, document.dump(1) + "\n");
    print(document);
  }
  std::fflush(stdout);
}

void run(ScheduleArguments& a) {
  for (const std::string& machines : a.machines) clusterOf(machines);
  for (const std::string& name : a.models) modelNamed(name);
  for (const std::string& path : {a.json, a.picture, a.trace}) {
    if (!path.empty() && path != "-") checkWritable(path);
  }
  a.live.picture = a.picture;
  a.live.trace = a.trace;
  if (a.live.bundle.empty()) {
    writeOut(measure(a), a.json, printTable);
  } else {
    writeOut(benchLive(a.live), a.json, printLive);
  }
}

void addCommand(CLI::App& bench) {
  auto a = std::make_shared<ScheduleArguments>();
  CLI::App* c = bench.add_subcommand(
      "schedule", "The scheduler against its rivals and a bound, simulated (docs/schedule.md)");
  c->add_option("--machines", a->machines, "Clusters: a letter of A, B, C, D, R for each machine")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->capture_default_str();
  c->add_option("--model", a->models, "Workloads: boeing, sponza, proximity, particles")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->capture_default_str();
  c->add_option("--seeds", a->seeds, "Workloads of each kind, and machines' disturbances")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  c->add_flag("--same-eviction", a->sameEviction,
              "Rivals foresee and evict as we do: what the choice of jobs alone is worth");
  c->add_option("--json", a->json, "Write the document to this file; - is stdout");
  c->add_option("-o,--output", a->picture,
                "Write our schedule of the first cluster and workload as a picture: FILE.svg");
  c->add_option("--trace", a->trace, "The same for trace viewers (Chrome, Perfetto): FILE.json");
  c->add_option(
      "--live", a->live.bundle,
      "Render this streamed bundle on this machine instead: all pages in memory, on demand, "
      "with paths that wait for pages, and foreseeing");
  c->add_option("--size", a->live.size, "Of --live: WxH in pixels")->capture_default_str();
  c->add_option("--spp", a->live.samples, "Of --live: samples a pixel")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  c->add_option("--demand-spp", a->live.demandSamples,
                "Of --live: those on demand, which is slow; 0: leave it out")
      ->check(CLI::Range(0, 1 << 20))
      ->capture_default_str();
  c->add_option("--exact", a->live.exact, "Of --live: share of exact samples; below 1 with photons")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  c->add_option("--cache-share", a->live.cacheShare, "Of --live: of the pages that may be there")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  c->add_option("--ray-memory", a->live.rayMemory, "Of --live: as of trex render")
      ->capture_default_str();
  c->add_flag("--cold", a->live.cold, "Of --live: read pages past the system's cache");
  c->add_option("--disk-rate", a->live.diskRate,
                "Of --live: MB/s of a disk that is played, one request at a time; 0: this one")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  c->add_option("--disk-latency", a->live.diskLatency, "Of --live: ms of each of its requests")
      ->check(CLI::Range(0.0, 1e4))
      ->capture_default_str();
  c->callback([a] { run(*a); });
}

}  // namespace
}  // namespace schedule

void addBenchScheduleCommand(CLI::App& bench) { schedule::addCommand(bench); }

}  // namespace trex
