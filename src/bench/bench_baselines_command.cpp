// trex bench baselines: its command line and its table.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "src/bench/bench.h"
#include "src/bench/bench_baselines.h"
#include "src/command/interrupt.h"
#include "src/command/parse.h"
#include "src/command/render_arguments.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/threads.h"

namespace trex {
namespace {

using nlohmann::json;

/// What [Kim et al. 2014] tell of their machine, whose device is a GPU.
constexpr double kPaperPhotonsOverDevice = 135.0, kPaperCpuOverDevice = 3.9;

struct BaselinesCommand {
  BaselineArguments bench;
  RenderArguments render;
  std::string exact = "0", json;
  int threads = 0;
};

void printBaselines(const json& document) {
  fmt::print("{:<10} {:>9} {:>8} {:>10} {:>7} {:>11}\n", "", "seconds", "samples", "relMSE", "FLIP",
             "mean ratio");
  for (const json& run : document["runs"]) {
    for (const json& p : run["points"]) {
      fmt::print("{:<10} {:>9.2f} {:>8} {:>10.4g} {:>7.4f} {:>11.4f}\n",
                 run["name"].get<std::string>(), p["seconds"].get<double>(),
                 p["samples"].get<std::uint32_t>(), p["relmse"].get<double>(),
                 p["flip"].get<double>(), p["mean_ratio"].get<double>());
    }
  }
  if (!document.contains("ratios")) return;
  const json& ratios = document["ratios"];
  fmt::print("seconds to relMSE {:.4g}, the best that all reach:\n",
             document["common_relmse"].get<double>());
  const auto line = [&](const char* text, const char* key, double paper) {
    if (!ratios.contains(key)) return;
    fmt::print("  {:<46} {:>8.2f} times", text, ratios[key].get<double>());
    fmt::print("{}\n", paper > 0.0 ? fmt::format("   (in the paper {:g})", paper) : "");
  };
  line("photon mapping over ours without a device", "photons_over_cpu", 0.0);
  line("ours without a device over ours with it", "cpu_over_device", kPaperCpuOverDevice);
  line("photon mapping over ours with the device", "photons_over_device", kPaperPhotonsOverDevice);
  if (document.value("device_shares_cores", false)) {
    fmt::print(
        "The device runs on the CPU's own cores: what a GPU beside them is worth can't be shown on "
        "this machine.\n");
  }
}

int runBaselines(BaselinesCommand& a) {
  readSettings(a.render);
  if (std::isnan(a.bench.seconds) || std::isnan(a.bench.referenceSeconds)) {
    fail(ExitCode::kUsage, "--seconds nan: want seconds");
  }
  a.bench.settings = a.render.settings;
  setExact(a.exact, a.bench.settings);
  a.bench.settings.samples = 0;  // time alone ends a run
  if (a.bench.referenceSeconds <= 0.0) a.bench.referenceSeconds = 4.0 * a.bench.seconds;
  for (const std::string& path : {a.bench.scene.input, a.bench.scene.reference}) {
    if (path == "auto" || path.starts_with("synth:") || std::filesystem::is_regular_file(path)) {
      continue;
    }
    fail(ExitCode::kInput, "{}: no such file", path);
  }
  if (!a.json.empty() && a.json != "-") checkWritable(a.json);
  const ThreadLimit limit(a.threads);
  catchInterrupts();
  const json document = benchBaselines(a.bench);
  if (a.json == "-") {
    fmt::print("{}\n", document.dump(1));
  } else {
    if (!a.json.empty()) writeTextAtomically(a.json, document.dump(1) + "\n");
    printBaselines(document);
  }
  std::fflush(stdout);
  const int signal = interruptedBy();
  return signal == 0 ? 0 : 128 + signal;
}

}  // namespace

void addBenchBaselinesCommand(CLI::App& bench, int& exitCode) {
  auto a = std::make_shared<BaselinesCommand>();
  CLI::App* c = bench.add_subcommand(
      "baselines", "Photon mapping, this program without a device, and with one, at equal error");
  c->add_option("MODEL", a->bench.scene.input, "Model: .gltf .glb .ply .obj .stl .xml .pbrt")
      ->required();
  c->add_option("--reference", a->bench.scene.reference, "Reference picture, or auto: exact mode")
      ->default_str("auto");
  c->add_option("--seconds", a->bench.seconds, "Seconds of each run, start-up not counted")
      ->check(CLI::Range(0.01, 1e6))
      ->capture_default_str();
  c->add_option("--reference-seconds", a->bench.referenceSeconds,
                "Seconds of a reference that is rendered [4 times --seconds]")
      ->check(CLI::Range(0.0, 1e6));
  a->render.size = "256x256";
  c->add_option("--size", a->render.size, "WxH in pixels")->capture_default_str();
  c->add_option("--photons", a->bench.photons, "Photons of photon mapping")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 28))
      ->capture_default_str();
  c->add_option("--nearest", a->bench.nearest, "Photons that it takes an irradiance of")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  c->add_option("--exact", a->exact, "Our share of samples traced exactly, 0 to 1, or auto")
      ->capture_default_str();
  c->add_option("--env", a->bench.scene.environment, "Environment, as of trex render");
  c->add_option("--device", a->render.device, "Vulkan device: number, auto or none")
      ->capture_default_str();
  addGuess(*c, a->render.settings);
  c->add_option("--seed", a->render.settings.seed, "Seed of all random numbers")
      ->capture_default_str();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--json", a->json, "Write the document to this file; - is stdout");
  c->callback([a, &exitCode] { exitCode = runBaselines(*a); });
}

}  // namespace trex
