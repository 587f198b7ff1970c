// trex render INPUT -o OUT: headless capture.
#include <memory>
#include <string>

#include "src/app/app.h"
#include "src/app/capture.h"
#include "src/app/render_machines.h"
#include "src/app/render_open.h"
#include "src/command/parse.h"
#include "src/core/threads.h"
#include "src/machines/mpi_wire.h"

namespace trex {
namespace {

int render(RenderArguments& a) {
  readSettings(a);
  layersOf(a);
  exposureOf(a, Picture{});
  const ThreadLimit limit(a.threads);
  if (machines::startedAs().size > 1) return renderTogether(a);
  checkFiles(a);
  OpenedRender opened;
  openForRender(a, {}, opened);
  opened.applyLook();
  Capture capture(a, std::move(opened.model), std::move(opened.views), opened.importSeconds);
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
  addGuess(*c, a->settings);
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
  c->add_option("--page-disk", a->pageDisk,
                "Disk for pages that were unpacked once where these don't fit in memory, such as "
                "20G, auto (half of what is free) or off: a temporary file beside the picture")
      ->capture_default_str();
  c->add_option(
       "--page-order", a->pageOrder,
       "In which order pages are loaded that paths wait for: plan, or, to compare with it, "
       "round-robin over blocks of pages; the picture is the same")
      ->check(CLI::IsMember({"plan", "round-robin"}))
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
  c->add_option(
       "--scene-db", a->sceneDb,
       "Where machines started by mpirun have the model from: central (machine 0 alone has "
       "it) or local (each has a copy)")
      ->check(CLI::IsMember({"central", "local"}))
      ->capture_default_str();
  c->add_option("--stale", a->stale, "A bundle whose model has changed since: refuse or use")
      ->check(CLI::IsMember({"refuse", "use"}))
      ->capture_default_str();
  c->add_flag("--json", a->json, "Print a JSON summary on stdout");
  c->callback([a, &exitCode] {
    if (a->output.empty()) fail(ExitCode::kUsage, "-o '': want the name of a picture");
    exitCode = render(*a);
  });
}

}  // namespace trex
