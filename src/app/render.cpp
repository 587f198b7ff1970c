// trex render INPUT -o OUT: headless capture.
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/app/app.h"
#include "src/app/interrupt.h"
#include "src/app/progress.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/core/version.h"
#include "src/scene/import.h"
#include "src/session/session.h"

namespace trex {
namespace {

struct RenderArguments {
  std::string input, output;
  std::string size = "640x360", camera, environment, device = "auto", guess = "auto",
              exposure = "auto", denoise = "auto";
  std::string maxMemory;
  std::vector<std::string> layers;
  RenderSettings settings;
  int threads = 0;
  bool json = false;
};

void readSettings(RenderArguments& a) {
  parseSize(a.size, a.settings.width, a.settings.height);
  if (std::isnan(a.settings.exact)) fail(ExitCode::kUsage, "--exact nan: want 0 to 1");
  if (std::isnan(a.settings.seconds)) fail(ExitCode::kUsage, "--time nan: want seconds");
  if (!a.maxMemory.empty()) a.settings.maxMemory = parseBytes(a.maxMemory);
  if (a.settings.samples == 0 && a.settings.seconds == 0.0) a.settings.samples = 64;
  if (a.device == "none") {
    a.settings.device = RenderSettings::kNoDevice;
  } else if (a.device != "auto") {
    char* end = nullptr;
    const long number = std::strtol(a.device.c_str(), &end, 10);
    if (end == a.device.c_str() || *end != '\0' || number < 0 || number > 255) {
      fail(ExitCode::kUsage, "--device {}: want a number, auto or none", a.device);
    }
    a.settings.device = static_cast<int>(number);
  }
  a.settings.denoise = a.denoise == "auto";
  a.settings.guess = a.guess == "ray"    ? GuessKind::kRay
                     : a.guess == "cone" ? GuessKind::kCone
                                         : GuessKind::kAuto;
}

float exposureOf(const RenderArguments& a, const Picture& picture) {
  if (a.exposure == "auto") return autoExposure(picture);
  char* end = nullptr;
  const float stops = std::strtof(a.exposure.c_str(), &end);
  if (end == a.exposure.c_str() || *end != '\0' || !(std::abs(stops) < 100.0f)) {
    fail(ExitCode::kUsage, "--exposure {}: want stops or auto", a.exposure);
  }
  return stops;
}

/// Refuses before anything large is allocated.
void checkBudget(const RenderArguments& a, const Scene& scene) {
  const bool pairs = a.settings.exact > 0.0 && a.settings.exact < 1.0;
  const std::uint64_t frame =
      Accumulator::bytesNeeded(a.settings.width, a.settings.height, pairs) +
      (a.settings.denoise ? FeatureImage::bytesNeeded(a.settings.width, a.settings.height) * 4
                          : 0) +
      std::uint64_t{a.settings.width} * a.settings.height * 16 * sizeof(float);
  constexpr std::uint64_t kMeshBytesATriangle = 120;  // source, clusters and build, measured peak
  const std::uint64_t mesh = scene.uniqueTriangleCount() * kMeshBytesATriangle;
  const std::uint64_t limit = a.settings.maxMemory ? a.settings.maxMemory : availableMemoryLimit();
  if (frame + mesh > limit) {
    fail(ExitCode::kMemoryOrDevice,
         "needs about {} ({} for the frame, {} for the model), allowed are {}; make --size smaller "
         "or --max-memory larger",
         formatBytes(frame + mesh), formatBytes(frame), formatBytes(mesh), formatBytes(limit));
  }
}

nlohmann::json summary(const RenderArguments& a, const SessionReport& r, double importSeconds,
                       float exposure) {
  return {{"input", a.input},
          {"output", a.output},
          {"width", a.settings.width},
          {"height", a.settings.height},
          {"samples", r.samplesDone},
          {"exact", a.settings.exact},
          {"seed", a.settings.seed},
          {"device", r.device},
          {"guess", r.device == "none" ? "none"
                    : r.cones          ? "cone"
                                       : "ray"},
          {"triangles", r.mesh.triangles},
          {"unique_triangles", r.mesh.uniqueTriangles},
          {"instances", r.mesh.instances},
          {"import_seconds", importSeconds},
          {"mesh_build_seconds", r.meshSeconds},
          {"voxel_build_seconds", r.voxelSeconds},
          {"device_start_seconds", r.deviceSeconds},
          {"render_seconds", r.renderSeconds},
          {"photon_seconds", r.photonSeconds},
          {"photons", r.photons},
          {"photons_landed", r.photonsLanded},
          {"c_rays", r.rays.cRays},
          {"shadow_rays", r.rays.shadowRays},
          {"g_rays", r.rays.cones},
          {"cache_reads", r.rays.cacheReads},
          {"exact_paths", r.rays.exactPaths},
          {"mesh_bytes", r.mesh.meshBytes},
          {"top_level_bytes", r.mesh.topLevelBytes},
          {"voxels", r.voxels},
          {"voxel_depth", r.voxelDepth},
          {"voxel_bytes", r.voxelBytes},
          {"nonfinite_samples", r.nonFinite},
          {"exposure_stops", exposure},
          {"peak_resident_bytes", peakResidentBytes()}};
}

void addMetadata(Picture& picture, const RenderArguments& a, const SessionReport& r) {
  const auto put = [&](const char* key, const std::string& value) {
    picture.metadata.emplace_back(std::string("trex:") + key, value);
  };
  put("version", kVersion);
  put("scene", std::filesystem::path(a.input).filename().string());
  put("camera", a.camera.empty() ? "first" : a.camera);
  put("samples", std::to_string(r.samplesDone));
  put("seed", std::to_string(a.settings.seed));
  put("exact", fmt::format("{}", a.settings.exact));
  put("device", r.device);
  put("nonFiniteSamples", std::to_string(r.nonFinite));
}

int finish(const RenderArguments& a, const Session& session, double importSeconds) {
  Picture picture = session.picture();
  const SessionReport report = session.report();
  addMetadata(picture, a, report);
  const float exposure = exposureOf(a, picture);
  writePicture(a.output, picture, ToneMap{exposure});
  if (report.nonFinite > 0) {
    const NonFiniteSample first = session.frame().nonFiniteSamples().front();
    logWarning(
        "{} samples were not finite and were dropped; the first: pixel {},{} sample {} seed {}",
        report.nonFinite, first.x, first.y, first.sample, a.settings.seed);
  }
  if (a.json) {
    fmt::print("{}\n", summary(a, report, importSeconds, exposure).dump(2));
  } else {
    fmt::print("{}\n", a.output);
  }
  std::fflush(stdout);
  logInfo("{} samples a pixel in {:.2f} s on {}", report.samplesDone, report.renderSeconds,
          report.device == "none" ? "the CPU alone" : report.device);
  const int signal = interruptedBy();
  return signal == 0 ? 0 : 128 + signal;
}

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

int render(RenderArguments& a) {
  readSettings(a);
  if (!knownPictureExtension(a.output)) {
    fail(ExitCode::kUsage, "-o {}: unknown picture format; use .exr or .png", a.output);
  }
  exposureOf(a, Picture{});
  checkWritable(a.output);
  std::optional<tbb::global_control> limit;
  if (a.threads > 0) {
    limit.emplace(tbb::global_control::max_allowed_parallelism,
                  static_cast<std::size_t>(a.threads));
    setenv("LP_NUM_THREADS", std::to_string(a.threads).c_str(), 0);  // lavapipe's own threads
  }
  const double start = seconds();
  ImportOptions options;
  options.environmentGiven = !a.environment.empty();
  Scene scene = importScene(a.input, options);
  if (!a.environment.empty()) scene.environment = parseEnvironment(a.environment);
  const Camera camera = a.camera.empty() ? scene.cameras.front() : parseCamera(a.camera, scene);
  checkBudget(a, scene);
  const double importSeconds = seconds() - start;
  logVerbose("{}: {} triangles, {} unique, {} instances", a.input, scene.triangleCount(),
             scene.uniqueTriangleCount(), scene.instances.size());
  catchInterrupts();
  PictureLayers layers;
  for (const std::string& name : a.layers) {
    layers.variance |= name == "variance";
    layers.sampleCount |= name == "sampleCount";
    layers.features |= name == "features";
  }
  ModelOptions modelOptions;
  modelOptions.voxels = a.settings.exact < 1.0;
  modelOptions.voxelDepth = voxelDepthFor(std::uint64_t{a.settings.width} * a.settings.height);
  Session session(std::make_shared<const Model>(makeModel(std::move(scene), modelOptions)), camera,
                  a.settings, layers);
  {
    Progress progress;
    session.run([&](double share) {
      progress.show(share, session.samplesDone());
      return interruptedBy() == 0;
    });
  }
  return finish(a, session, importSeconds);
}

}  // namespace

void addRenderCommand(CLI::App& app, int& exitCode) {
  auto a = std::make_shared<RenderArguments>();
  CLI::App* c = app.add_subcommand("render", "Render a model to a picture without a window");
  c->add_option("INPUT", a->input, "Model: .gltf .glb .ply .obj")->required();
  c->add_option("-o,--output", a->output, "Picture: .exr (linear) or .png (tone-mapped)")
      ->required();
  c->add_option("--size", a->size, "WxH in pixels")->capture_default_str();
  c->add_option("--spp", a->settings.samples, "Samples a pixel [64 unless --time is given]");
  c->add_option("--time", a->settings.seconds, "Seconds of rendering, set-up not counted")
      ->check(CLI::Range(0.0, 1e9));
  c->add_option("--exact", a->settings.exact,
                "Share of samples traced exactly: 0 fast and biased, 1 a path tracer")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  c->add_option("--camera", a->camera,
                "Camera's name, or EYE/TARGET/UP/VFOV: x,y,z/x,y,z/x,y,z/degrees");
  c->add_option("--env", a->environment, "Environment: R,G,B or a latitude-longitude .hdr or .exr");
  c->add_option("--device", a->device, "Vulkan device of the G-rays: number, auto or none")
      ->capture_default_str();
  c->add_option("--guess", a->guess, "Guess of far, wide rays: auto, ray or cone")
      ->check(CLI::IsMember({"auto", "ray", "cone"}))
      ->capture_default_str();
  c->add_option("--exposure", a->exposure, "Exposure of .png in stops, or auto")
      ->capture_default_str();
  c->add_option("--aov", a->layers,
                "Layers of an .exr besides R, G, B: variance,sampleCount,features")
      ->delimiter(',')
      ->check(CLI::IsMember({"variance", "sampleCount", "features"}));
  c->add_option("--denoise", a->denoise, "Filter the guess: auto (with --exact 0), off")
      ->check(CLI::IsMember({"auto", "off"}))
      ->capture_default_str();
  c->add_option("--seed", a->settings.seed, "Seed of all random numbers")->capture_default_str();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--max-memory", a->maxMemory, "Memory this process may use, such as 8G [all]");
  c->add_flag("--json", a->json, "Print a JSON summary on stdout");
  c->callback([a, &exitCode] { exitCode = render(*a); });
}

}  // namespace trex
