// trex bench: figures of this program on this machine.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>

#include "src/bench/bench.h"
#include "src/bench/bench_hccmesh.h"
#include "src/bench/bench_tradeoff.h"
#include "src/bench/report_html.h"
#include "src/command/interrupt.h"
#include "src/command/parse.h"
#include "src/command/render_arguments.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/threads.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// A report of dozens of scenes with pictures is far below this.
constexpr std::uintmax_t kMostReportBytes = std::uintmax_t{1} << 30;

struct BenchArguments {
  std::vector<std::string> scenes, references, environments;
  std::vector<std::string> shares{"0", "0.05", "0.25", "1", "auto"};
  double seconds = 60.0, referenceSeconds = 0.0;
  int threads = 0;
  RenderArguments render;
  std::string from, html, json, svg;
};

std::string nameOf(const std::string& scene) { return fs::path(scene).stem().string(); }

/// The reference of scene `i`: from a folder, from the list, or "auto".
std::string referenceOf(const BenchArguments& a, std::size_t i) {
  const auto& given = a.references;
  if (given.empty() || (given.size() == 1 && given[0] == "auto")) return "auto";
  if (given.size() == 1 && fs::is_directory(given[0])) {
    return (fs::path(given[0]) / (nameOf(a.scenes[i]) + ".exr")).string();
  }
  if (given.size() != a.scenes.size()) {
    fail(ExitCode::kUsage, "--reference: {} given for {} scenes; give one each, a folder or auto",
         given.size(), a.scenes.size());
  }
  return given[i];
}

/// "NAME=E" for one scene goes before "E" for all.
std::string environmentOf(const BenchArguments& a, const std::string& name) {
  std::string all;
  for (const std::string& text : a.environments) {
    const std::size_t at = text.find('=');
    if (at == std::string::npos) {
      all = text;
    } else if (text.substr(0, at) == name) {
      return text.substr(at + 1);
    }
  }
  return all;
}

void checkEnvironments(const BenchArguments& a) {
  for (const std::string& text : a.environments) {
    const std::size_t at = text.find('=');
    if (at == std::string::npos) continue;
    bool known = false;
    for (const std::string& scene : a.scenes) known |= nameOf(scene) == text.substr(0, at);
    if (!known) fail(ExitCode::kUsage, "--env {}: no scene has this name", text);
  }
}

/// What a run of hours would stumble over at its end.
void checkFiles(const BenchArguments& a) {
  for (std::size_t i = 0; i < a.scenes.size(); ++i) {
    for (const std::string& path : {a.scenes[i], referenceOf(a, i)}) {
      if (path == "auto" || fs::is_regular_file(path)) continue;
      fail(ExitCode::kInput, "{}: no such file{}", path,
           path.find('=') == std::string::npos ? "" : "; repeat --env for each NAME=E");
    }
  }
}

TradeoffArguments readArguments(BenchArguments& a) {
  if (a.scenes.empty()) fail(ExitCode::kUsage, "SCENE: name a model, or a report with --from");
  if (std::isnan(a.seconds) || std::isnan(a.referenceSeconds)) {
    fail(ExitCode::kUsage, "--seconds nan: want seconds");
  }
  checkEnvironments(a);
  checkFiles(a);
  readSettings(a.render);
  TradeoffArguments out{{}, {}, a.seconds, a.referenceSeconds, a.render.settings};
  out.settings.samples = 0;  // time alone ends a run
  for (const std::string& share : a.shares) setExact(share, out.runs.emplace_back(out.settings));
  if (out.referenceSeconds <= 0.0) out.referenceSeconds = 4.0 * a.seconds;
  for (std::size_t i = 0; i < a.scenes.size(); ++i) {
    out.scenes.push_back({a.scenes[i], referenceOf(a, i), environmentOf(a, nameOf(a.scenes[i])),
                          a.render.import.maxBounces});
  }
  return out;
}

json readReport(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  if (error || size > kMostReportBytes) {
    fail(ExitCode::kInput, "{}: not a report that can be read", path);
  }
  std::ifstream file(path);
  json document = json::parse(file, nullptr, false);
  if (!document.is_object() || document.value("bench", json()) != "tradeoff") {
    fail(ExitCode::kInput, "{}: not a report of trex bench tradeoff", path);
  }
  return document;
}

/// Names of scenes may come from a report's text; they must not lead out of the folder.
void writeCharts(const fs::path& folder, const json& document) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail(ExitCode::kOutput, "{}: {}", folder.string(), error.message());
  for (const json& scene : document.at("scenes")) {
    const std::string name = fs::path(scene.at("name").get<std::string>()).filename().string();
    for (const char* metric : {"relmse", "flip"}) {
      writeTextAtomically(folder / fmt::format("{}-{}.svg", name, metric),
                          tradeoffSvg(scene, metric));
    }
  }
}

void printTable(const json& document) {
  for (const json& scene : document.at("scenes")) {
    fmt::print("{}\n", scene.at("name").get<std::string>());
    for (const json& run : scene.at("runs")) {
      for (const json& p : run.at("points")) {
        fmt::print(
            "  exact {:<5} {:8.2f} s {:7} samples  relMSE {:<10.4g} FLIP {:.4f}  mean "
            "ratio {:.4f}\n",
            shareText(run), p.at("seconds").get<double>(), p.at("samples").get<std::uint32_t>(),
            p.at("relmse").get<double>(), p.at("flip").get<double>(),
            p.at("mean_ratio").get<double>());
      }
    }
  }
}

void writeOutputs(const BenchArguments& a, const json& document) {
  if (!a.json.empty() && a.json != "-") writeTextAtomically(a.json, document.dump(1) + "\n");
  try {
    if (!a.html.empty()) writeTextAtomically(a.html, tradeoffHtml(document));
    if (!a.svg.empty()) writeCharts(a.svg, document);
    if (a.json == "-") {
      fmt::print("{}\n", document.dump(1));
    } else if (a.from.empty()) {
      printTable(document);
    }
  } catch (const json::exception& e) {
    fail(ExitCode::kInput, "{}: a report that lacks something: {}", a.from, e.what());
  }
  std::fflush(stdout);
}

int tradeoff(BenchArguments& a) {
  for (const std::string& path : {a.html, a.json}) {
    if (!path.empty() && path != "-") checkWritable(path);
  }
  if (!a.from.empty()) {
    if (!a.scenes.empty()) fail(ExitCode::kUsage, "--from and SCENE: give one of them");
    writeOutputs(a, readReport(a.from));
    return 0;
  }
  const TradeoffArguments arguments = readArguments(a);
  const ThreadLimit limit(a.threads);
  catchInterrupts();
  // Hours of work are kept as they are done.
  const auto keep = [&](const json& document) {
    if (!a.json.empty() && a.json != "-") writeTextAtomically(a.json, document.dump(1) + "\n");
  };
  writeOutputs(a, benchTradeoff(arguments, keep));
  const int signal = interruptedBy();
  return signal == 0 ? 0 : 128 + signal;
}

void addHccmeshBench(CLI::App& bench) {
  struct Arguments {
    HccmeshBenchArguments bench;
    std::string json;
    int threads = 0;
  };
  auto a = std::make_shared<Arguments>();
  CLI::App* c = bench.add_subcommand(
      "hccmesh", "Bytes a triangle and rays a second, against Embree's own triangles");
  c->add_option("INPUT", a->bench.input, "Model: .gltf .glb .ply .obj .stl .xml .pbrt")->required();
  c->add_option("--camera", a->bench.camera, "NAME or EYE/TARGET/UP/VFOV [the scene's first]");
  c->add_option("--precision", a->bench.precisionBits, "Grid cells along the extent: 2^bits")
      ->check(CLI::Range(8, 24))
      ->capture_default_str();
  c->add_option("--runs", a->bench.runs, "Medians of so many runs")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  c->add_option("--rays", a->bench.rays, "Rays of each kind")
      ->check(CLI::Range(std::uint64_t{1024}, std::uint64_t{1} << 26))
      ->capture_default_str();
  c->add_flag("!--no-embree", a->bench.embree, "HCCMesh alone");
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--json", a->json, "Write the document to this file; - is stdout");
  c->callback([a] {
    if (!a->json.empty() && a->json != "-") checkWritable(a->json);
    const ThreadLimit limit(a->threads);
    const nlohmann::ordered_json document = benchHccmesh(a->bench);
    if (a->json == "-") {
      fmt::print("{}\n", document.dump(1));
    } else {
      printHccmeshBench(document);
      if (!a->json.empty()) writeTextAtomically(a->json, document.dump(1) + "\n");
    }
    std::fflush(stdout);
  });
}

}  // namespace

void addBenchCommand(CLI::App& app, int& exitCode) {
  auto a = std::make_shared<BenchArguments>();
  CLI::App* bench = app.add_subcommand("bench", "Measure this program on this machine");
  bench->require_subcommand(1);
  addHccmeshBench(*bench);
  addBenchAsvoCommand(*bench);
  addBenchScheduleCommand(*bench);
  addBenchBaselinesCommand(*bench, exitCode);
  CLI::App* c =
      bench->add_subcommand("tradeoff", "Error over time for several shares of exactness");
  c->add_option("SCENE", a->scenes, "Models: .gltf .glb .ply .obj .stl .xml .pbrt");
  c->add_option(
       "--reference", a->references,
       "Reference picture: one a scene, a folder with NAME.exr, or auto: exact mode [auto]")
      ->allow_extra_args(false);
  c->add_option("--seconds", a->seconds, "Seconds of each run, start-up not counted")
      ->check(CLI::Range(0.01, 1e6))
      ->capture_default_str();
  c->add_option("--reference-seconds", a->referenceSeconds,
                "Seconds of a reference that is rendered [4 times --seconds]")
      ->check(CLI::Range(0.0, 1e6));
  a->render.size = "256x256";
  c->add_option("--size", a->render.size, "WxH in pixels")->capture_default_str();
  c->add_option("--exact", a->shares, "Shares of samples traced exactly, 0 to 1, or auto")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->capture_default_str();
  c->add_option("--env", a->environments,
                "Environment for all scenes, or NAME=E for one; may be repeated")
      ->allow_extra_args(false);
  addMaxBounces(*c, a->render.import);
  c->add_option("--device", a->render.device, "Vulkan device: number, auto or none")
      ->capture_default_str();
  addGuess(*c, a->render.settings);
  addPhotonBounces(*c, a->render.settings.photonKind);
  addDenoise(*c, a->render.settings.denoise);
  c->add_option("--seed", a->render.settings.seed, "Seed of all random numbers")
      ->capture_default_str();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--json", a->json, "Write the document to this file; - is stdout");
  c->add_option("--html", a->html, "Write a page with curves, pictures and tables");
  c->add_option("--svg", a->svg, "Write the curves of each scene into this folder");
  c->add_option("--from", a->from, "Draw the document of an earlier run again");
  c->callback([a, &exitCode] { exitCode = tradeoff(*a); });
}

}  // namespace trex
