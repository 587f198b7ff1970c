// trex bake INPUT -o X.trex: imports, compresses, voxelises, and keeps the result in one file.
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/app/app.h"
#include "src/app/progress.h"
#include "src/bundle/bundle.h"
#include "src/bundle/stream_bake.h"
#include "src/command/interrupt.h"
#include "src/command/parse.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/log.h"
#include "src/core/memory.h"
#include "src/scene/synth.h"
#include "src/session/preflight.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

struct BakeArguments {
  std::string input, output, environment, maxMemory;
  std::vector<std::string> volumes;
  int depth = 8, precision = 24, threads = 0;
  bool noVoxels = false, stream = false, resume = false, json = false;
  ImportOptions import;  ///< without volumes, environment and the memory limit
};

/// Seconds by phase, for --json.
class Phases {
 public:
  /// Ends the phase under way and names the next.
  void next(const char* name) {
    const double at = secondsNow();
    if (!current_.empty()) seconds_[current_ + "_seconds"] = at - since_;
    current_ = name;
    since_ = at;
  }
  void set(const std::string& name, double seconds) { seconds_[name + "_seconds"] = seconds; }
  nlohmann::ordered_json json() const {
    nlohmann::ordered_json out = seconds_;
    out["total_seconds"] = secondsNow() - start_;
    return out;
  }

 private:
  nlohmann::ordered_json seconds_ = nlohmann::ordered_json::object();
  std::string current_;
  double start_ = secondsNow(), since_ = start_;
};

/// Only a bundle may be replaced; says which.
void checkTarget(const fs::path& target) {
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(target, error);
  if (error) return;
  char start[8] = {};
  std::ifstream(target, std::ios::binary).read(start, sizeof(start));
  if (!bundle::hasBundleMagic(std::as_bytes(std::span(start)))) {
    fail(ExitCode::kOutput, "{}: exists and is not a trex bundle; remove it or name another file",
         target.string());
  }
  logInfo("{}: replacing a bundle of {}", target.string(), formatBytes(bytes));
}

void checkArguments(const BakeArguments& a) {
  if (!isBundlePath(a.output)) {
    fail(ExitCode::kUsage, "-o {}: a bundle's name ends in .trex", a.output);
  }
  if (isBundlePath(a.input)) {
    fail(ExitCode::kUsage, "{}: is a bundle; bake the model that it was made from", a.input);
  }
  checkWritable(a.output);
  checkTarget(a.output);
  for (const fs::path& path : removeDeadTemporaries(a.output)) {
    logInfo("{}: removed what an interrupted bake left", path.string());
  }
}

std::uint64_t maxMemoryOf(const BakeArguments& a) {
  return a.maxMemory.empty() ? 0 : parseBytes("--max-memory", a.maxMemory);
}

/// What does not fit is put aside beside the bundle.
std::shared_ptr<TextureCache> texturesOf(const BakeArguments& a) {
  RenderSettings settings;
  settings.maxMemory = maxMemoryOf(a);
  return textureCacheFor(settings, fs::absolute(a.output).parent_path());
}

std::vector<VolumeRequest> volumesOf(const BakeArguments& a) {
  std::vector<VolumeRequest> out;
  for (const std::string& v : a.volumes) out.push_back(parseVolume(v));
  return out;
}

/// Bytes that voxels may take; refuses what does not fit before anything large is allocated.
std::uint64_t voxelBudget(const BakeArguments& a, const Scene& scene) {
  RenderSettings settings;
  settings.width = settings.height = 1;
  settings.device = RenderSettings::kNoDevice;
  settings.exact = a.noVoxels ? 1.0 : 0.0;
  settings.maxMemory = maxMemoryOf(a);
  return preflight(scene, settings, {}).voxelBytes;
}

nlohmann::ordered_json bytesByPart(const std::vector<bundle::Section>& sections) {
  nlohmann::ordered_json out = {{"scene_bytes", 0},  {"hccmesh_bytes", 0}, {"emitter_bytes", 0},
                                {"medium_bytes", 0}, {"voxel_bytes", 0},   {"texture_bytes", 0}};
  for (const bundle::Section& s : sections) {
    const char* part = s.name == "scene.json"                                      ? "scene_bytes"
                       : s.name.ends_with(".hccm") || s.name.starts_with("world.") ? "hccmesh_bytes"
                       : s.name == "emitters.bin"                                  ? "emitter_bytes"
                       : s.name.ends_with(".fog")                                  ? "medium_bytes"
                       : s.name == "voxels.asvo"                                   ? "voxel_bytes"
                                                 : "texture_bytes";
    out[part] = out[part].get<std::uint64_t>() + s.bytes;
  }
  return out;
}

void report(const BakeArguments& a, const Model& model, const Phases& phases,
            const std::vector<bundle::Section>& sections) {
  const std::uint64_t bytes = fs::file_size(a.output);
  if (!a.json) {
    fmt::print("{} {} bytes\n", a.output, bytes);
    return;
  }
  const RayScene::Statistics mesh = model.rays->statistics();
  nlohmann::ordered_json out = {{"input", a.input},
                                {"output", a.output},
                                {"bytes", bytes},
                                {"triangles", mesh.triangles},
                                {"unique_triangles", mesh.uniqueTriangles},
                                {"instances", mesh.instances},
                                {"replaced_parts", model.scene.replaced.count},
                                {"voxel_depth", model.voxels ? model.voxels->info.depth : 0}};
  out.update(bytesByPart(sections));
  out.update(phases.json());
  out["peak_resident_bytes"] = peakResidentBytes();
  fmt::print("{}\n", out.dump(2));
}

Scene import(const BakeArguments& a, std::vector<SourceFile>& files) {
  ImportOptions options = a.import;
  options.environmentGiven = !a.environment.empty();
  options.volumes = volumesOf(a);
  options.maxMemory = maxMemoryOf(a);
  options.textures = texturesOf(a);
  Scene scene = importScene(a.input, options);
  files = scene.files;
  if (a.environment.empty()) return scene;
  std::error_code error;
  const std::string file = environmentFile(a.environment);
  if (fs::is_regular_file(file, error)) files.push_back(examineSource(file));
  scene.environment = parseEnvironment(a.environment);
  return scene;
}

/// The file is written under interrupts that leave no rest.
std::vector<bundle::Section> write(const BakeArguments& a, const Model& model,
                                   const BakeFacts& facts) {
  catchInterrupts();
  try {
    return saveBundle(a.output, model, facts,
                      [](std::uint64_t, std::uint64_t) { return interruptedBy() == 0; });
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInterrupted) throw;
    throw Error(static_cast<ExitCode>(128 + interruptedBy()), e.what());
  }
}

/// False, with nothing done, if it does not fit.
bool bakeInMemory(const BakeArguments& a) {
  Phases phases;
  phases.next("import");
  std::vector<SourceFile> files;
  Scene scene = import(a, files);
  std::uint64_t voxelBytes = 0;
  try {
    voxelBytes = voxelBudget(a, scene);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kMemoryOrDevice) throw;
    logInfo("{}: does not fit in memory as it is; baking it with --stream", a.input);
    return false;
  }
  logInfo("{}: {} triangles, {} unique; compressing{}", a.input, scene.triangleCount(),
          scene.uniqueTriangleCount(), a.noVoxels ? "" : " and voxelising");
  BakeFacts facts;
  facts.input = a.input;
  facts.requirements = bundle::requirementsOf(scene, !a.noVoxels);
  ModelOptions options;
  options.voxels = !a.noVoxels;
  options.voxelBytes = voxelBytes;
  options.voxelDepth = facts.voxelDepth = a.depth;
  options.precisionBits = facts.precisionBits = a.precision;
  phases.next("build");
  const Model model = makeModel(std::move(scene), options);
  phases.set("mesh_build", model.meshSeconds);
  phases.set("voxel_build", model.voxelSeconds);
  phases.next("hash");
  facts.files = hashSources(files, a.output);
  phases.next("write");
  logInfo("{}: writing", a.output);
  const std::vector<bundle::Section> sections = write(a, model, facts);
  phases.next("");
  report(a, model, phases, sections);
  return true;
}

std::uint64_t allowedMemory(const BakeArguments& a) {
  const std::uint64_t all = availableMemoryLimit();
  return a.maxMemory.empty() ? all : std::min(all, parseBytes("--max-memory", a.maxMemory));
}

/// Whether a model is baked as a stream: asked for, or its arrays and its build would not fit.
bool wantsStream(const BakeArguments& a) {
  if (a.stream || a.resume) return true;
  // Per triangle: arrays, and what the build holds beside them (preflight.cpp). A byte of a binary
  // file of positions becomes about six, one of points in eight triangles each about sixty.
  constexpr std::uint64_t kSynthBytes = 48 + 48 + 12;
  const std::uint64_t fileBytes = a.import.pointSize > 0.0 ? 60 : 6;
  if (isSynthName(a.input)) {
    const std::uint64_t triangles = parseSynthName(a.input).triangles;
    constexpr std::uint64_t kMostInMemory = 2'000'000;
    return triangles > kMostInMemory || triangles * kSynthBytes > allowedMemory(a);
  }
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(a.input, error);
  return !error && bytes * fileBytes > allowedMemory(a);
}

void announce(const BakeArguments& a, const StreamEstimate& e, std::uint64_t triangles) {
  logInfo(
      "{}: streaming {} triangles; about {} of memory (allowed {}), {} of disk ({} free), {:.0f} s",
      a.input, triangles, formatBytes(e.memory), formatBytes(e.allowed),
      formatBytes(e.spillBytes + e.bundleBytes), formatBytes(e.freeBytes), e.seconds);
}

void reportStream(const BakeArguments& a, const StreamBakeResult& r, const StreamEstimate& e,
                  const Phases& phases) {
  const std::uint64_t bytes = fs::file_size(a.output);
  if (!a.json) {
    fmt::print("{} {} bytes\n", a.output, bytes);
    return;
  }
  nlohmann::ordered_json out = {{"input", a.input},
                                {"output", a.output},
                                {"bytes", bytes},
                                {"streamed", true},
                                {"triangles", r.triangles},
                                {"dropped_triangles", r.droppedTriangles},
                                {"replaced_parts", r.replacedParts},
                                {"clusters", r.clusters},
                                {"pages", r.pages},
                                {"buckets", r.buckets},
                                {"buckets_reused", r.bucketsReused},
                                {"voxel_depth", r.voxelDepth}};
  out.update(bytesByPart(r.sections));
  out["estimated_memory_bytes"] = e.memory;
  out["estimated_disk_bytes"] = e.spillBytes + e.bundleBytes;
  out["estimated_seconds"] = e.seconds;
  out.update(phases.json());
  out["peak_resident_bytes"] = peakResidentBytes();
  fmt::print("{}\n", out.dump(2));
}

void bakeStreamed(const BakeArguments& a) {
  Phases phases;
  phases.next("import");
  ImportOptions import = a.import;
  import.environmentGiven = !a.environment.empty();
  import.maxMemory = maxMemoryOf(a);
  import.scratch = fs::absolute(a.output).parent_path();
  import.textures = texturesOf(a);
  Scene volumes;
  addVolumes(volumes, volumesOf(a), import.maxMemory);
  std::unique_ptr<TriangleStream> stream = openTriangleStream(a.input, import);
  StreamBakeOptions options;
  options.maxMemory = allowedMemory(a);
  options.precisionBits = a.precision;
  options.voxelDepth = a.noVoxels ? 0 : a.depth;
  options.resume = a.resume;
  options.maxBounces = a.import.maxBounces;
  BakeFacts facts;
  facts.input = a.input;
  facts.precisionBits = a.precision;
  facts.voxelDepth = a.depth;
  std::vector<SourceFile> files = stream->scene().files;
  files.insert(files.end(), volumes.files.begin(), volumes.files.end());
  options.media = std::move(volumes.media);
  for (const std::string& w : volumes.warnings) logWarning("{}", w);
  if (!a.environment.empty()) {
    std::error_code error;
    const std::string file = environmentFile(a.environment);
    if (fs::is_regular_file(file, error)) files.push_back(examineSource(file));
    options.environment = parseEnvironment(a.environment);
  }
  const StreamEstimate estimate = estimateStreamBake(*stream, options, a.output);
  announce(a, estimate, stream->triangleCount());
  phases.next("hash");
  facts.files = hashSources(files, a.output);
  phases.next("build");
  catchInterrupts();
  std::mutex mutex;
  std::map<std::string, Progress> bars;  // of each phase
  options.keepGoing = [&](const char* phase, double done) {
    const std::lock_guard lock(mutex);
    bars[phase].show(done, phase);
    return interruptedBy() == 0;
  };
  StreamBakeResult result;
  try {
    result = bakeStream(std::move(stream), options, facts, a.output);
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInterrupted) throw;
    throw Error(static_cast<ExitCode>(128 + interruptedBy()), e.what());
  }
  phases.set("sort", result.spillSeconds);
  phases.set("mesh_build", result.meshSeconds);
  phases.set("voxel_build", result.voxelSeconds);
  phases.next("");
  reportStream(a, result, estimate, phases);
}

void bake(const BakeArguments& a) {
  checkArguments(a);
  std::optional<tbb::global_control> limit;
  if (a.threads > 0) {
    limit.emplace(tbb::global_control::max_allowed_parallelism,
                  static_cast<std::size_t>(a.threads));
  }
  if (wantsStream(a) || !bakeInMemory(a)) bakeStreamed(a);
}

}  // namespace

void addBakeCommand(CLI::App& app) {
  auto a = std::make_shared<BakeArguments>();
  CLI::App* c = app.add_subcommand("bake", "Make a model ready for rays and keep it in one file");
  c->add_option("INPUT", a->input,
                "Model: .gltf .glb .ply .obj .stl .xml .pbrt, or synth:NAME?triangles=N&seed=S")
      ->required();
  c->add_option("-o,--output", a->output, "Bundle: X.trex")->required();
  c->add_option("--depth", a->depth,
                "Levels of voxels below the root; more where nearly all is empty")
      ->check(CLI::Range(1, static_cast<int>(asvo::ASVO_MAX_DEPTH)))
      ->capture_default_str();
  c->add_option("--precision", a->precision, "Grid cells along a mesh's largest extent: 2^BITS")
      ->check(CLI::Range(8, 24))
      ->capture_default_str();
  c->add_option("--env", a->environment, kEnvironmentHelp);
  c->add_option("--volume", a->volumes, kVolumeHelp)->allow_extra_args(false);
  c->add_flag("--no-voxels", a->noVoxels, "Leave voxels out: every sample will be exact");
  addImportOptions(*c, a->import);
  c->add_option("--max-memory", a->maxMemory, "Memory this process may use, such as 8G [all]");
  c->add_option("--threads", a->threads, "CPU threads [all]")->check(CLI::Range(1, 4096));
  c->add_flag("--stream", a->stream,
              "Build out of core, through temporary files beside the bundle [if it does not fit]");
  c->add_flag("--resume", a->resume,
              "Go on with a streamed bake that was stopped; implies --stream");
  c->add_flag("--json", a->json, "Print a JSON summary on stdout");
  c->callback([a] { bake(*a); });
}

}  // namespace trex
