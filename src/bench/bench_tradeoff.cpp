#include "src/bench/bench_tradeoff.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>

#include "src/bench/bench_score.h"
#include "src/command/interrupt.h"
#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/core/log.h"
#include "src/core/version.h"
#include "src/scene/import.h"
#include "src/session/preflight.h"
#include "src/session/session.h"

namespace trex {
namespace {

using nlohmann::json;

constexpr double kFirstPoint = 0.25;
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

json machine() {
  return {
      {"cpu", processorName()},
      {"threads", tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)},
      {"cores", tbb::info::default_concurrency()},
      {"device", "none"},
      {"version", kVersion}};
}

/// Runs until `seconds` of rendering in all; the first pass is finished in any case.
void runUntil(Session& session, double seconds) {
  const double start = secondsNow() - session.report().renderSeconds;
  session.run([&] {
    return interruptedBy() == 0 && (session.samplesDone() == 0 || secondsNow() - start < seconds);
  });
}

json raysOf(const SessionReport& r) {
  const std::uint64_t all = r.rays.cRays + r.rays.shadowRays + r.rays.cones + r.rays.cacheReads;
  const auto share = [&](std::uint64_t part) {
    return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0.0;
  };
  return {{"c_rays", r.rays.cRays},
          {"shadow_rays", r.rays.shadowRays},
          {"g_rays", r.rays.cones},
          {"cache_reads", r.rays.cacheReads},
          {"exact_paths", r.rays.exactPaths},
          {"c_ray_share", share(r.rays.cRays)},
          {"shadow_ray_share", share(r.rays.shadowRays)},
          {"g_ray_share", share(r.rays.cones)},
          {"cache_read_share", share(r.rays.cacheReads)}};
}

/// Takes the picture as it is, scores it, keeps it as an image of the report.
json measure(Session& session, const Scorer& scorer, json& shown) {
  const ColorImage image = colorsOf(session.picture(), "picture");
  const SessionReport report = session.report();
  json point = scorer.score(image);
  point["seconds"] = report.renderSeconds + report.filterSeconds;
  point["filter_seconds"] = report.filterSeconds;
  point["denoiser"] = report.denoiser;
  point["samples"] = report.samplesDone;
  shown = {{"seconds", point["seconds"]}, {"png_base64", scorer.png(image)}};
  return point;
}

json runShare(const std::shared_ptr<const Model>& model, const TradeoffArguments& a,
              const RenderSettings& settings, const Scorer& scorer, const std::string& name) {
  Session session(model, model->scene.cameras.front(), settings);
  json run = {{"exact", settings.dial ? json("auto") : json(settings.exact)},
              {"points", json::array()}};
  for (double target = kFirstPoint, last = 0.0; last < a.seconds && interruptedBy() == 0;) {
    target = std::min(target, a.seconds);
    runUntil(session, std::max(target - session.denoiseWithin(target), 0.1 * target));
    if (session.samplesDone() == 0) break;
    json shown;
    json point = measure(session, scorer, shown);
    last = point["seconds"];
    logInfo("{}, exact {}: {:.2f} s, {} samples, relMSE {:.4g}, FLIP {:.4f}", name, shareText(run),
            last, point["samples"].get<std::uint32_t>(), point["relmse"].get<double>(),
            point["flip"].get<double>());
    if (!run.contains("picture_early") || last <= 1.1) run["picture_early"] = shown;
    run["picture_last"] = shown;
    run["points"].push_back(std::move(point));
    if (target >= a.seconds) break;
    do {
      target *= 2.0;  // also where the run ended a little before its time
    } while (target <= last);
  }
  const SessionReport r = session.report();
  run["slope"] = settings.exact > 0.0 ? slopeOf(run["points"]) : json(nullptr);
  run["device"] = r.device;
  run["guess"] = r.device == "none" ? "none" : r.cones ? "cone" : "ray";
  run["device_start_seconds"] = r.deviceSeconds;
  run["aim_seconds"] = r.aimSeconds;
  run["render_seconds"] = r.renderSeconds;
  run["photon_seconds"] = r.photonSeconds;
  run["photons"] = r.photons;
  run["nonfinite_samples"] = r.nonFinite;
  run["rays"] = raysOf(r);
  return run;
}

json sharesOf(const TradeoffArguments& a) {
  json shares = json::array();
  for (const RenderSettings& s : a.runs) {
    shares.push_back(s.dial ? json("auto") : json(s.exact));
  }
  return shares;
}

/// The exact mode as its own reference.
Scorer renderReference(const std::shared_ptr<const Model>& model, const TradeoffArguments& a,
                       json& told) {
  RenderSettings settings = a.settings;
  settings.exact = 1.0;
  settings.seed += kReferenceSeed;
  Session session(model, model->scene.cameras.front(), settings);
  runUntil(session, a.referenceSeconds);
  const SessionReport r = session.report();
  told = {{"file", "auto"}, {"seconds", r.renderSeconds}, {"samples", r.samplesDone}};
  const ColorImage image = colorsOf(session.picture(), "reference");
  return {image, image};
}

std::shared_ptr<const Model> prepare(const TradeoffScene& scene, const TradeoffArguments& a,
                                     json& setup) {
  const double start = secondsNow();
  ImportOptions options;
  options.environmentGiven = !scene.environment.empty();
  Scene imported = importScene(scene.input, options);
  if (options.environmentGiven) imported.environment = parseEnvironment(scene.environment);
  const double importSeconds = secondsNow() - start;
  ModelOptions build;
  build.voxels = std::any_of(a.runs.begin(), a.runs.end(),
                             [](const RenderSettings& s) { return s.exact < 1.0; });
  build.voxelDepth = voxelDepthFor(std::uint64_t{a.settings.width} * a.settings.height);
  RenderSettings settings = a.settings;
  settings.exact = build.voxels ? 0.0 : 1.0;
  build.voxelBytes = preflight(imported, settings, {}).voxelBytes;
  auto model = std::make_shared<const Model>(makeModel(std::move(imported), build));
  setup = {{"import_seconds", importSeconds},
           {"mesh_build_seconds", model->meshSeconds},
           {"voxel_build_seconds", model->voxelSeconds},
           {"triangles", model->rays->statistics().triangles}};
  return model;
}

json benchScene(const TradeoffScene& scene, const TradeoffArguments& a) {
  const std::string name = std::filesystem::path(scene.input).stem().string();
  json out = {{"name", name},
              {"input", scene.input},
              {"environment", scene.environment.empty() ? json(nullptr) : json(scene.environment)},
              {"runs", json::array()},
              {"peers", json::array()}};
  // A bad reference is told before minutes of work.
  std::optional<Scorer> scorer;
  const bool own = scene.reference == "auto";
  if (!own) {
    scorer.emplace(readReference(scene.reference, a.settings.width, a.settings.height));
    out["reference"] = {{"file", scene.reference}};
  }
  const auto model = prepare(scene, a, out["setup"]);
  if (own) scorer.emplace(renderReference(model, a, out["reference"]));
  out["reference"]["png_base64"] = scorer->referencePng();
  for (const RenderSettings& settings : a.runs) {
    if (interruptedBy() != 0) break;
    out["runs"].push_back(runShare(model, a, settings, *scorer, name));
  }
  return out;
}

}  // namespace

json slopeOf(const json& points) {
  double n = 0.0, sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  for (std::size_t i = points.size() / 2; i < points.size(); ++i) {
    const double error = points[i].at("relmse");
    if (!(error > 0.0) || !std::isfinite(error)) return nullptr;
    const double x = std::log(points[i].at("seconds").get<double>()), y = std::log(error);
    n += 1.0;
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  const double spread = n * sxx - sx * sx;
  return n < 2.0 || spread <= 0.0 ? json(nullptr) : json((n * sxy - sx * sy) / spread);
}

std::string shareText(const json& run) {
  const json& share = run.at("exact");
  return share.is_string() ? share.get<std::string>() : fmt::format("{:g}", share.get<double>());
}

json benchTradeoff(const TradeoffArguments& a, const std::function<void(const json&)>& sceneDone) {
  json out = {{"bench", "tradeoff"},
              {"machine", machine()},
              {"settings",
               {{"width", a.settings.width},
                {"height", a.settings.height},
                {"seconds", a.seconds},
                {"seed", a.settings.seed},
                {"exact", sharesOf(a)}}},
              {"scenes", json::array()}};
  for (const TradeoffScene& scene : a.scenes) {
    if (interruptedBy() != 0) break;
    out["scenes"].push_back(benchScene(scene, a));
    for (const json& run : out["scenes"].back()["runs"]) {
      if (run["device"] != "none") out["machine"]["device"] = run["device"];
    }
    sceneDone(out);
  }
  return out;
}

}  // namespace trex
