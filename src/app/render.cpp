// trex render INPUT -o OUT: headless capture.
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>

#include "src/app/app.h"
#include "src/app/capture.h"
#include "src/bundle/bundle.h"
#include "src/command/interrupt.h"
#include "src/command/parse.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/frame/image_file.h"
#include "src/images/image_library.h"
#include "src/scene/import.h"
#include "src/scene/look_file.h"
#include "src/session/model_editor.h"
#include "src/session/preflight.h"
#include "src/session/samples.h"
#include "src/vulkan/vulkan.h"

namespace trex {
namespace {

void checkOutputs(const std::vector<View>& views, const std::string& checkpoint) {
  namespace fs = std::filesystem;
  for (const View& view : views) {
    checkWritable(view.output);
    if (!checkpoint.empty() &&
        fs::weakly_canonical(view.output) == fs::weakly_canonical(checkpoint)) {
      fail(ExitCode::kUsage, "--checkpoint {}: is the picture's file too; name another",
           checkpoint);
    }
  }
  if (!checkpoint.empty()) checkWritable(checkpoint);
}

void setThreads(int threads, std::optional<tbb::global_control>& limit) {
  if (threads <= 0) return;
  limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 0);  // lavapipe's own threads
}

/// The overlay's look; what it asks of the model and the settings is set. An exposure or a camera
/// of the command line goes before the look's.
Look readEdits(RenderArguments& a, const Scene& scene, ModelOptions& options) {
  LookLight light;
  Look look = readLook(a.edits, scene, lookOf(scene), &light);
  a.settings.photons = light.photons;
  a.settings.aim = light.aim;
  options.voxelsInTheDark = true;
  if (a.exposure == "auto" && look.exposure != 0.0f) a.exposure = fmt::format("{}", look.exposure);
  return look;
}

/// Memory of paths that wait for pages. `left`: for these and the pages; `cache`: what was asked
/// for these, or 0. Throws Error(kMemoryOrDevice) if it is not there.
std::uint64_t rayMemory(const RenderSettings& s, const std::string& asked, std::uint64_t cache,
                        std::uint64_t left) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
  const std::uint64_t room = left > cache ? left - cache : 0;
  if (asked == "off") return 0;
  if (asked == "auto") {
    const std::uint64_t samples = s.samples > 0 ? s.samples : 64;
    const std::uint64_t all = memoryOfPaths(std::uint64_t{s.width} * s.height * samples);
    return std::min({all, kMost, cache > 0 ? room : left / 4});
  }
  const std::uint64_t bytes = parseBytes(asked);
  if (bytes > room || (cache == 0 && bytes > left / 4 * 3)) {
    fail(ExitCode::kMemoryOrDevice,
         "--ray-memory {}: {} are left for pages and paths that wait for them; make it or --cache "
         "smaller, or --max-memory larger",
         asked, formatBytes(left));
  }
  return bytes;
}

/// Limit of pages in memory: as asked for, or most of what the rest leaves. Where they don't fit
/// paths wait for them, and the settings get the memory of these.
std::uint64_t cacheFor(RenderArguments& a, const PagedSizes& paged, const Preflight& fit) {
  a.settings.rayMemory = 0;
  if (paged.pages == 0) return 0;
  const std::uint64_t left = (fit.allowed - fit.needed) / 8 * 7;
  std::uint64_t cache = a.cache.empty() ? std::max<std::uint64_t>(left, 1)
                                        : std::max<std::uint64_t>(parseBytes(a.cache), 1);
  if (cache < paged.pages) {
    a.settings.rayMemory = rayMemory(a.settings, a.rayMemory, a.cache.empty() ? 0 : cache, left);
    if (a.cache.empty()) cache = left - a.settings.rayMemory;
  }
  logVerbose("memory: {:>10} of pages, at most {} at a time", formatBytes(paged.pages),
             formatBytes(std::min(cache, paged.pages)));
  logVerbose("memory: {:>10} of paths that wait for pages", formatBytes(a.settings.rayMemory));
  return std::min(cache, paged.pages);
}

int render(RenderArguments& a) {
  readSettings(a);
  const PictureLayers layers = layersOf(a);
  exposureOf(a, Picture{});
  checkWritable(a.output);
  if (!a.trace.empty()) checkWritable(a.trace);
  std::optional<tbb::global_control> limit;
  setThreads(a.threads, limit);
  const double start = secondsNow();
  if (!isBundlePath(a.input)) checkSourceFits(a.input, a.settings);
  OpenOptions open;
  open.useStale = a.stale == "use";
  if (!a.environment.empty()) open.environment = parseEnvironment(a.environment);
  open.import = a.import;
  for (const std::string& v : a.volumes) open.import.volumes.push_back(parseVolume(v));
  open.import.maxMemory = a.settings.maxMemory;
  // Beside the picture there is room for what does not fit.
  open.import.textures =
      textureCacheFor(a.settings, std::filesystem::absolute(a.output).parent_path());
  open.model.voxels = a.settings.exact < 1.0;
  open.model.voxelDepth = voxelDepthFor(std::uint64_t{a.settings.width} * a.settings.height);
  std::vector<View> views;
  std::optional<Look> look;
  ModelOptions built;
  double importSeconds = 0.0;
  std::jthread imagesOpening;
  std::optional<vulkan::DriversAhead> drivers;
  open.prepare = [&](const Scene& scene, ModelOptions& model) {
    if (needsImageLibrary(a.output)) imagesOpening = openImageLibraryBehind();
    if (!a.edits.empty()) look = readEdits(a, scene, model);
    views = makeViews(a, scene, look);
    checkOutputs(views, a.checkpoint);
    importSeconds = secondsNow() - start;
    logVerbose("{}: {} triangles, {} unique, {} instances", a.input, scene.triangleCount(),
               scene.uniqueTriangleCount(), scene.instances.size());
    if (scene.maxBounces < 2) model.voxels = false;  // their light has made two
    const std::uint64_t baked = isBundlePath(a.input)
                                    ? std::filesystem::file_size(a.input) - model.paged.disk
                                    : std::uint64_t{0};
    // So that what the library takes is counted.
    if (a.settings.maxMemory > 0 && imagesOpening.joinable()) imagesOpening.join();
    const Preflight fit = preflight(scene, a.settings, layers, baked, model.paged.topLevel);
    model.voxelBytes = fit.voxelBytes;
    model.cacheBytes = cacheFor(a, model.paged, fit);
    built = model;
    catchInterrupts();
    const bool device = model.voxels && a.settings.device != RenderSettings::kNoDevice;
    if (device) drivers.emplace();
  };
  auto model = std::make_shared<Model>(openModel(a.input, open));
  if (look) applyLook(model, *look, built);
  Capture capture(a, std::move(model), std::move(views), importSeconds);
  return capture.run();
}

/// How a picture for the eye is made of radiance.
void addFileOptions(CLI::App& c, RenderArguments& a) {
  c.add_option("--exposure", a.exposure, "Exposure of .png and .jpg in stops, or auto")
      ->capture_default_str();
  c.add_option("--tonemap", a.tonemap,
               "Highlights of .png and .jpg: none (cut off), neutral (Khronos PBR Neutral) or agx")
      ->check(CLI::IsMember(toneOperatorNames()))
      ->capture_default_str();
  c.add_flag("--transparent", a.settings.transparent,
             "No background: the environment lights but is not seen by the camera, and pictures "
             "get an alpha channel (.exr premultiplied, .png not)");
  c.add_option("--bits", a.file.bits, "Bits of a value of a .png: 8 or 16")
      ->check(CLI::IsMember({8, 16}))
      ->capture_default_str();
  c.add_option("--quality", a.file.quality, "Of a .jpg, 1 to 100")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
}

}  // namespace

void addRenderCommand(CLI::App& app, int& exitCode) {
  auto a = std::make_shared<RenderArguments>();
  CLI::App* c = app.add_subcommand("render", "Render a model to a picture without a window");
  c->add_option("INPUT", a->input,
                "Model: .gltf .glb .ply .obj .stl .xml .pbrt, a baked .trex, or "
                "synth:NAME?triangles=N&seed=S")
      ->required();
  c->add_option("-o,--output", a->output, "Picture: .exr (linear), .png or .jpg (tone-mapped)")
      ->required();
  c->add_option("--size", a->size, "WxH in pixels")->capture_default_str();
  c->add_option("--spp", a->settings.samples, "Samples a pixel [64 unless --time is given]");
  c->add_option("--time", a->settings.seconds, "Seconds of rendering, filter included, set-up not")
      ->check(CLI::Range(0.0, 1e9));
  c->add_option(
       "--error", a->settings.error,
       "Stop at this estimated relMSE: with --exact auto of noise and bias, else of the noise")
      ->check(CLI::Range(0.0, 1e9));
  addExact(*c, a->settings);
  c->add_option("--camera", a->cameras,
                std::string(kCameraHelp) + "; may be repeated; all: every camera of the file")
      ->allow_extra_args(false);
  c->add_option("--path", a->path,
                "Cameras from a file, one picture each: {\"trex\": 1, \"cameras\": [..]}");
  c->add_option("--edits", a->edits, "Edits saved by the viewer, a JSON overlay on the scene");
  c->add_option("--env", a->environment, kEnvironmentHelp);
  c->add_option("--volume", a->volumes, kVolumeHelp)->allow_extra_args(false);
  addImportOptions(*c, a->import);
  c->add_option("--device", a->device, "Vulkan device of the G-rays: number, auto or none")
      ->capture_default_str();
  c->add_option("--guess", a->guess, "Guess of far, wide rays: auto, ray or cone")
      ->check(CLI::IsMember({"auto", "ray", "cone"}))
      ->capture_default_str();
  addPhotonBounces(*c, a->settings.photonKind);
  addFileOptions(*c, *a);
  c->add_option("--aov", a->layers,
                "Layers of an .exr besides R, G, B: A,direct,indirect,albedo,normal,position,depth,"
                "objectId,materialId,sampleCount,variance or all")
      ->delimiter(',')
      ->allow_extra_args(false);
  addDenoise(*c, a->settings.denoise);
  c->add_option("--seed", a->settings.seed, "Seed of all random numbers")->capture_default_str();
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_option("--max-memory", a->maxMemory, "Memory this process may use, such as 8G [all]");
  c->add_option("--texture-memory", a->textureMemory,
                "Memory for textures, such as 1G; those that don't fit are read from disk in tiles "
                "[half of what --max-memory leaves beside the program, else all]");
  c->add_option("--cache", a->cache,
                "Memory for pages of a streamed bundle, such as 2G [what --max-memory leaves]");
  c->add_option(
       "--ray-memory", a->rayMemory,
       "Memory for paths that wait for pages where these don't fit, such as 512M, auto or off "
       "(threads wait)")
      ->capture_default_str();
  c->add_option("--trace", a->trace,
                "File for the timelines of loading and tracing where paths wait for pages: .svg or "
                ".html a picture, else JSON for Chrome's and Perfetto's viewers");
  c->add_option("--max-gpu-memory", a->maxGpuMemory,
                "Device memory that may be used, such as 2G [all]");
  c->add_option("--checkpoint", a->checkpoint,
                "File that keeps the state, saved on a timer and on an interrupt");
  c->add_option("--checkpoint-seconds", a->checkpointSeconds, "Seconds between checkpoints")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str();
  c->add_flag("--resume", a->resume, "Go on from the checkpoint if there is one");
  c->add_option("--stale", a->stale, "A bundle whose model has changed since: refuse or use")
      ->check(CLI::IsMember({"refuse", "use"}))
      ->capture_default_str();
  c->add_flag("--json", a->json, "Print a JSON summary on stdout");
  c->callback([a, &exitCode] { exitCode = render(*a); });
}

}  // namespace trex
