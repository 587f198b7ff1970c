#include "src/bench/bench_scene.h"

#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <fstream>

#include "src/command/interrupt.h"
#include "src/core/clock.h"
#include "src/core/version.h"
#include "src/scene/import.h"
#include "src/session/preflight.h"

namespace trex {
namespace {

using nlohmann::json;

/// Added to the seed of a reference that is rendered here: it must not share the runs' noise.
constexpr std::uint32_t kReferenceSeed = 0x5eed0000u;

std::string processorName() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("model name")) continue;
    const std::size_t at = line.find(": ");
    if (at != std::string::npos) return line.substr(at + 2);
  }
  return "unknown";
}

}  // namespace

json benchMachine() {
  return {
      {"cpu", processorName()},
      {"threads", tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)},
      {"cores", tbb::info::default_concurrency()},
      {"device", "none"},
      {"version", kVersion}};
}

std::shared_ptr<const Model> benchModel(const BenchScene& scene, const RenderSettings& settings,
                                        bool voxels, json& setup) {
  const double start = secondsNow();
  ImportOptions options;
  options.environmentGiven = !scene.environment.empty();
  options.maxBounces = scene.maxBounces;
  Scene imported = importScene(scene.input, options);
  if (options.environmentGiven) imported.environment = parseEnvironment(scene.environment);
  const double importSeconds = secondsNow() - start;
  ModelOptions build;
  build.voxels = voxels;
  build.voxelDepth = voxelDepthFor(std::uint64_t{settings.width} * settings.height);
  RenderSettings needs = settings;
  needs.exact = voxels ? 0.0 : 1.0;
  build.voxelBytes = preflight(imported, needs, {}).voxelBytes;
  auto model = std::make_shared<const Model>(makeModel(std::move(imported), build));
  setup = {{"import_seconds", importSeconds},
           {"mesh_build_seconds", model->meshSeconds},
           {"voxel_build_seconds", model->voxelSeconds},
           {"triangles", model->rays->statistics().triangles}};
  return model;
}

Scorer benchReference(const BenchScene& scene, const std::shared_ptr<const Model>& model,
                      const RenderSettings& settings, double seconds, json& told) {
  if (scene.reference != "auto") {
    told = {{"file", scene.reference}};
    return readReference(scene.reference, settings.width, settings.height);
  }
  RenderSettings exact = settings;
  exact.exact = 1.0;
  exact.seed += kReferenceSeed;
  Session session(model, model->scene.cameras.front(), exact);
  runUntil(session, seconds);
  const SessionReport r = session.report();
  told = {{"file", "auto"}, {"seconds", r.renderSeconds}, {"samples", r.samplesDone}};
  const ColorImage image = colorsOf(session.picture(), "reference");
  return {image, image};
}

void runUntil(Session& session, double seconds) {
  const double start = secondsNow() - session.report().renderSeconds;
  session.run([&] {
    return interruptedBy() == 0 && (session.samplesDone() == 0 || secondsNow() - start < seconds);
  });
}

bool BenchPoints::goOn(double taken) {
  if (next_ >= seconds_ || taken >= seconds_) return false;
  do {
    next_ *= 2.0;  // also where the run ended a little before its time
  } while (next_ <= taken);
  return true;
}

}  // namespace trex
