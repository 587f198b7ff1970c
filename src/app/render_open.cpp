#include "src/app/render_open.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "src/bundle/page_disk.h"
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

namespace trex {
namespace {

namespace fs = std::filesystem;

/// Throws Error(kOutput) if it can't be written, and removes what killed processes left beside it.
void checkOutput(const std::filesystem::path& file) {
  checkWritable(file);
  for (const std::filesystem::path& left : removeDeadTemporaries(file)) {
    logInfo("{}: removed what an interrupted trex left", left.string());
  }
}

void checkOutputs(const std::vector<View>& views, const std::string& checkpoint) {
  for (const View& view : views) {
    checkOutput(view.output);
    if (!checkpoint.empty() &&
        fs::weakly_canonical(view.output) == fs::weakly_canonical(checkpoint)) {
      fail(ExitCode::kUsage, "--checkpoint {}: is the picture's file too; name another",
           checkpoint);
    }
  }
  if (!checkpoint.empty()) checkOutput(checkpoint);
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
std::uint64_t rayMemory(const Scene& scene, const RenderSettings& s, const std::string& asked,
                        std::uint64_t cache, std::uint64_t left) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
  const std::uint64_t room = left > cache ? left - cache : 0;
  if (asked == "off") return 0;
  if (asked == "auto") {
    const std::uint64_t samples = s.samples > 0 ? s.samples : 64;
    const std::uint64_t all = memoryOfPaths(scene, std::uint64_t{s.width} * s.height * samples);
    return std::min({all, kMost, cache > 0 ? room : left / 4});
  }
  const std::uint64_t bytes = parseBytes("--ray-memory", asked);
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
std::uint64_t cacheFor(RenderArguments& a, const Scene& scene, const PagedSizes& paged,
                       const Preflight& fit) {
  a.settings.rayMemory = 0;
  if (paged.pages == 0) return 0;
  // Threads, who reads pages and who writes the picture take some of their own (measured: 5 to 10).
  constexpr std::uint64_t kWorkBytes = 8u << 20;
  const std::uint64_t rest = fit.allowed - fit.needed;
  const std::uint64_t left = (rest > kWorkBytes ? rest - kWorkBytes : 0) / 8 * 7;
  std::uint64_t cache = a.cache.empty()
                            ? std::max<std::uint64_t>(left, 1)
                            : std::max<std::uint64_t>(parseBytes("--cache", a.cache), 1);
  if (cache < paged.pages) {
    a.settings.rayMemory =
        rayMemory(scene, a.settings, a.rayMemory, a.cache.empty() ? 0 : cache, left);
    if (a.cache.empty()) cache = left - a.settings.rayMemory;
  }
  logVerbose("memory: {:>10} of pages, at most {} at a time", formatBytes(paged.pages),
             formatBytes(std::min(cache, paged.pages)));
  logVerbose("memory: {:>10} of paths that wait for pages", formatBytes(a.settings.rayMemory));
  return std::min(cache, paged.pages);
}

/// Where there is room for what does not fit in memory: beside the picture; a machine that writes
/// none has its folder for such files.
fs::path folderFor(const RenderArguments& a, const RenderSource& source) {
  return source.writes ? fs::absolute(a.output).parent_path() : fs::temp_directory_path();
}

/// What --page-disk lets be taken in a folder.
std::uint64_t diskAllowed(const RenderArguments& a, const fs::path& folder) {
  if (a.pageDisk == "off") return 0;
  return a.pageDisk == "auto" ? spareDisk(folder) : parseBytes("--page-disk", a.pageDisk);
}

/// For pages that were unpacked.
PageDisk diskFor(const RenderArguments& a, const RenderSource& source, std::uint64_t pages) {
  if (a.pageDisk == "off" || pages == 0) return {};
  const fs::path folder = folderFor(a, source);
  std::uint64_t bytes = diskAllowed(a, folder);
  if (source.file) bytes -= diskForOthers(a, folder, source.bytes);
  if (a.pageDisk == "auto") bytes = std::min(bytes, 2 * pages);
  logVerbose("disk: {:>10} in {} for pages that were unpacked", formatBytes(bytes),
             folder.string());
  return {folder, bytes};
}

/// What the model is opened with, before its scene is known.
OpenOptions optionsOf(const RenderArguments& a, const RenderSource& source) {
  OpenOptions open;
  open.useStale = a.stale == "use";
  open.import = a.import;
  open.import.maxMemory = a.settings.maxMemory;
  open.import.textures = textureCacheFor(a.settings, folderFor(a, source));
  open.model.voxels = a.settings.exact < 1.0;
  open.model.voxelDepth = voxelDepthFor(std::uint64_t{a.settings.width} * a.settings.height);
  if (source.made) return open;  // environment and volumes are in it
  const std::string& environment = source.environment.empty() ? a.environment : source.environment;
  if (!environment.empty()) open.environment = parseEnvironment(environment);
  for (const std::string& v : a.volumes) open.import.volumes.push_back(parseVolume(v));
  return open;
}

}  // namespace

void checkFiles(const RenderArguments& a) {
  checkWritable(a.output);
  checkIsNotInput(a.output, a.input);
  if (!a.environment.empty()) checkIsNotInput(a.output, environmentFile(a.environment));
  if (!a.trace.empty()) checkWritable(a.trace);
}

std::uint64_t diskForOthers(const RenderArguments& a, const fs::path& folder,
                            std::uint64_t modelBytes) {
  return std::min(diskAllowed(a, folder) / 4, modelBytes);
}

void openForRender(RenderArguments& a, const RenderSource& source, OpenedRender& out) {
  const double start = secondsNow();
  if (!source.file && !isBundlePath(a.input)) checkSourceFits(a.input, a.settings);
  OpenOptions open = optionsOf(a, source);
  open.prepare = [&](const Scene& scene, ModelOptions& model) {
    if (source.writes && needsImageLibrary(a.output)) out.imagesOpening = openImageLibraryBehind();
    if (!a.edits.empty()) out.look = readEdits(a, scene, model);
    out.views = makeViews(a, scene, out.look);
    if (source.writes) checkOutputs(out.views, a.checkpoint);
    out.importSeconds = secondsNow() - start;
    logVerbose("{}: {} triangles, {} unique, {} instances", a.input, scene.triangleCount(),
               scene.uniqueTriangleCount(), scene.instances.size());
    if (scene.maxBounces < 2) model.voxels = false;  // their light has made two
    // So that what the library takes is counted.
    if (a.settings.maxMemory > 0 && out.imagesOpening.joinable()) out.imagesOpening.join();
    const Preflight fit =
        preflight(scene, a.settings, layersOf(a), model.bakedVoxels, model.paged.topLevel);
    model.voxelBytes = fit.voxelBytes;
    model.cacheBytes = cacheFor(a, scene, model.paged, fit);
    if (model.cacheBytes < model.paged.pages)
      model.pageDisk = diskFor(a, source, model.paged.pages);
    out.built = model;
    catchInterrupts();
    const bool device = model.voxels && a.settings.device != RenderSettings::kNoDevice;
    if (device) out.drivers.emplace();
  };
  out.model = std::make_shared<Model>(
      source.file ? openRemoteBundle(source.file, source.bytes, a.input, open)
                  : openModel(a.input, open));
}

void OpenedRender::applyLook() {
  if (look) trex::applyLook(model, *look, built);
}

}  // namespace trex
