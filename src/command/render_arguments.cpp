#include "src/command/render_arguments.h"

#include <fmt/format.h>

#include <cmath>

#include "src/command/camera_path.h"
#include "src/command/kept_record.h"
#include "src/command/parse.h"
#include "src/core/error.h"
#include "src/scene/import.h"

namespace trex {
namespace {

/// Name of picture `number` of several.
std::string numbered(const std::string& output, std::size_t number) {
  const std::size_t dot = output.find_last_of('.');
  const std::size_t last = output.find_last_of('#');
  if (last == std::string::npos) {
    return fmt::format("{}.{:04}{}", output.substr(0, dot), number, output.substr(dot));
  }
  std::size_t first = last;
  while (first > 0 && output[first - 1] == '#') --first;
  return fmt::format("{}{:0{}}{}", output.substr(0, first), number, last - first + 1,
                     output.substr(last + 1));
}

}  // namespace

void readSettings(RenderArguments& a) {
  RenderSettings& s = a.settings;
  parseSize(a.size, s.width, s.height);
  if (std::isnan(a.import.atSeconds)) fail(ExitCode::kUsage, "--at nan: want seconds");
  if (std::isnan(s.seconds)) fail(ExitCode::kUsage, "--time nan: want seconds");
  if (std::isnan(s.error)) fail(ExitCode::kUsage, "--error nan: want a relMSE above 0");
  if (!a.maxMemory.empty()) s.maxMemory = parseBytes("--max-memory", a.maxMemory);
  if (!a.maxGpuMemory.empty()) s.maxGpuMemory = parseBytes("--max-gpu-memory", a.maxGpuMemory);
  if (!a.textureMemory.empty()) s.textureMemory = parseBytes("--texture-memory", a.textureMemory);
  // Wrong whether or not the model has pages that ask for it.
  if (!a.cache.empty()) parseBytes("--cache", a.cache);
  if (a.rayMemory != "auto" && a.rayMemory != "off") parseBytes("--ray-memory", a.rayMemory);
  if (a.pageDisk != "auto" && a.pageDisk != "off") parseBytes("--page-disk", a.pageDisk);
  if (s.samples == 0 && s.seconds == 0.0 && s.error == 0.0) s.samples = 64;
  if (a.pageOrder == "round-robin") s.loadOrder = LoadOrder::kInTurn;
  s.device = parseDevice(a.device);
  s.machine = measuredMachine(s);
  if (!a.path.empty() && !a.cameras.empty()) {
    fail(ExitCode::kUsage, "--path and --camera: give one of them");
  }
  if (!a.output.empty() && !knownPictureExtension(a.output)) {
    fail(ExitCode::kUsage, "-o {}: unknown picture format; use .exr, .png or .jpg", a.output);
  }
  s.recordTraffic = !a.trace.empty();
  if (s.transparent && isJpeg(a.output)) {
    fail(ExitCode::kUsage, "-o {}: a .jpg has no alpha for --transparent; use .exr or .png",
         a.output);
  }
  if (a.file.bits == 16 && (isExr(a.output) || isJpeg(a.output))) {
    fail(ExitCode::kUsage, "-o {}: --bits is of a .png alone", a.output);
  }
  if (a.resume && a.checkpoint.empty()) {
    fail(ExitCode::kUsage, "--resume: needs --checkpoint FILE to go on from");
  }
}

PictureLayers layersOf(const RenderArguments& a) {
  PictureLayers layers = layersFromNames(a.layers);
  layers.alpha |= a.settings.transparent;
  return layers;
}

std::vector<View> makeViews(const RenderArguments& a, const Scene& scene,
                            const std::optional<Look>& look) {
  std::vector<Camera> cameras;
  if (!a.path.empty()) {
    cameras = readCameraPath(a.path, scene);
  } else if (a.cameras.empty()) {
    cameras.push_back(look ? look->camera
                           : framedFor(scene.cameras.front(), a.settings.width, a.settings.height));
  } else if (a.cameras.size() == 1 && a.cameras.front() == "all") {
    cameras = scene.cameras;
  } else {
    for (const std::string& text : a.cameras) cameras.push_back(parseCamera(text, scene));
  }
  std::vector<View> views;
  const bool many = cameras.size() > 1 || !a.path.empty();
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    views.push_back({cameras[i], many ? numbered(a.output, i + 1) : a.output});
  }
  return views;
}

}  // namespace trex
