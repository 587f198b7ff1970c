#include "src/app/view/view_arguments.h"

#include <CLI/CLI.hpp>
#include <cmath>

#include "src/command/kept_record.h"
#include "src/command/parse.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/version.h"
#include "src/scene/import.h"

namespace trex {
namespace {

/// As written; read once all are there.
struct Texts {
  std::string input, edits, size = "1280x720", device = "auto";
  std::string stale = "refuse", sceneDb = "central", maxMemory, maxGpuMemory, cache, replay, report,
              screenshotFolder = ".";
  std::uint32_t samples = 4096;
  double budgetMs = 33.0;
  bool quiet = false, verbose = false;
};

void addOptions(CLI::App& c, Texts& t, ViewArguments& a) {
  RenderSettings& s = a.viewer.settings;
  c.add_option("INPUT", t.input, "Model: .gltf .glb .ply .obj .stl .xml .pbrt, or a baked .trex");
  c.add_option("--edits", t.edits, "Edits to start from: a .json that the viewer has saved");
  c.add_option("--volume", a.viewer.volumes, kVolumeHelp)->allow_extra_args(false);
  addImportOptions(c, a.viewer.import);
  c.add_option("--env", a.viewer.environment, kEnvironmentHelp);
  c.add_option("--camera", a.viewer.camera, kCameraHelp);
  c.add_option("--size", t.size, "Of the window: WxH in pixels")->capture_default_str();
  c.add_option("--scale", a.scale, "Window pixels a pixel of the picture: 1, 2 or 4")
      ->check(CLI::IsMember({1, 2, 4}))
      ->capture_default_str();
  addExact(c, s);
  c.add_option("--spp", t.samples, "Samples a pixel at which refining ends")
      ->check(CLI::Range(1u, 1u << 20))
      ->capture_default_str();
  addGuess(c, s);
  addPhotonBounces(c, a.viewer.settings.photonKind);
  addDenoise(c, s.denoise);
  c.add_option("--device", t.device, "Vulkan device of the G-rays: number, auto or none")
      ->capture_default_str();
  c.add_option("--seed", s.seed, "Seed of all random numbers")->capture_default_str();
  c.add_option("--threads", a.threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c.add_option("--budget-ms", t.budgetMs, "Milliseconds a step of work may take")
      ->check(CLI::Range(5.0, 1000.0))
      ->capture_default_str();
  c.add_option("--max-memory", t.maxMemory, "Memory this process may use, such as 8G [all]");
  c.add_option("--max-gpu-memory", t.maxGpuMemory,
               "Device memory that may be used, such as 2G [all]");
  c.add_option("--cache", t.cache, "Memory for pages of a streamed bundle, such as 2G [all]");
  c.add_option("--stale", t.stale, "A bundle whose model has changed since: refuse or use")
      ->check(CLI::IsMember({"refuse", "use"}))
      ->capture_default_str();
  c.add_option("--scene-db", t.sceneDb,
               "Where machines started by mpirun have the model from: central (this one alone has "
               "it) or local (each has a copy)")
      ->check(CLI::IsMember({"central", "local"}))
      ->capture_default_str();
  c.add_option("--replay", t.replay, "Run this script in an invisible window: see docs/viewer.md");
  c.add_option("--report", t.report, "Write what the replay measured to this .json [stdout]");
  c.add_option("--screenshot-dir", t.screenshotFolder, "Where pictures are saved")
      ->capture_default_str();
  c.add_flag("-q,--quiet", t.quiet, "Errors alone");
  c.add_flag("-v,--verbose", t.verbose, "Say more");
}

void read(const Texts& t, ViewArguments& a) {
  RenderSettings& s = a.viewer.settings;
  if (std::isnan(t.budgetMs)) fail(ExitCode::kUsage, "--budget-ms nan: want 5 to 1000");
  if (!t.report.empty() && t.replay.empty()) {
    fail(ExitCode::kUsage, "--report: needs --replay SCRIPT to report on");
  }
  if (s.denoise == Denoise::kOidn) {
    fail(ExitCode::kUsage, "--denoise oidn: the window has the filter alone; trex render has both");
  }
  if (s.denoise == Denoise::kAuto) s.denoise = s.exact < 1.0 ? Denoise::kFilter : Denoise::kOff;
  parseSize(t.size, a.width, a.height);
  s.width = a.width;
  s.height = a.height;
  s.samples = t.samples;
  s.device = parseDevice(t.device);
  s.machine = measuredMachine(s);
  if (!t.maxMemory.empty()) s.maxMemory = parseBytes("--max-memory", t.maxMemory);
  if (!t.maxGpuMemory.empty()) s.maxGpuMemory = parseBytes("--max-gpu-memory", t.maxGpuMemory);
  if (!t.cache.empty())
    a.viewer.cacheBytes = std::max<std::uint64_t>(parseBytes("--cache", t.cache), 1);
  a.viewer.input = t.input;
  a.viewer.edits = t.edits;
  a.viewer.useStale = t.stale == "use";
  a.localModel = t.sceneDb == "local";
  a.viewer.budgetSeconds = 1e-3 * t.budgetMs;
  a.replay = t.replay;
  a.report = t.report;
  a.screenshotFolder = t.screenshotFolder;
  if (t.quiet) setLogLevel(LogLevel::kError);
  if (t.verbose) setLogLevel(LogLevel::kVerbose);
}

}  // namespace

ViewArguments readViewArguments(int argc, const char* const* argv) {
  CLI::App app{"Open a model in a window: look around, edit, refine", "trex view"};
  app.footer(
      "Press H in the window for its keys. Exit codes: 0 closed, 1 failed, 2 usage, 3 input,\n"
      "4 memory, device or no display, 5 output not written, 130/143 interrupted.");
  app.set_version_flag("--version", std::string("trex ") + kVersion);
  ViewArguments a;
  Texts t;
  addOptions(app, t, a);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() != static_cast<int>(CLI::ExitCodes::Success)) {
      fail(ExitCode::kUsage, "{}; see trex view --help", e.what());
    }
    app.exit(e);
    a.help = true;
    return a;
  }
  read(t, a);
  return a;
}

}  // namespace trex
