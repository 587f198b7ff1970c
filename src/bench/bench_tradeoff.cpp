#include "src/bench/bench_tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "src/command/interrupt.h"
#include "src/core/log.h"
#include "src/session/session.h"

namespace trex {
namespace {

using nlohmann::json;

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
  for (BenchPoints points(a.seconds); interruptedBy() == 0;) {
    const double target = points.next();
    runUntil(session, std::max(target - session.denoiseWithin(target), 0.1 * target));
    if (session.samplesDone() == 0) break;
    json shown;
    json point = measure(session, scorer, shown);
    const double seconds = point["seconds"];
    logInfo("{}, exact {}: {:.2f} s, {} samples, relMSE {:.4g}, FLIP {:.4f}", name, shareText(run),
            seconds, point["samples"].get<std::uint32_t>(), point["relmse"].get<double>(),
            point["flip"].get<double>());
    if (!run.contains("picture_early") || seconds <= 1.1) run["picture_early"] = shown;
    run["picture_last"] = shown;
    run["points"].push_back(std::move(point));
    if (!points.goOn(seconds)) break;
  }
  const SessionReport r = session.report();
  run["slope"] = settings.exact > 0.0 ? slopeOf(run["points"]) : json(nullptr);
  run["device"] = r.device;
  run["guess"] = r.device == "none" ? "none" : guessText(r.coneShare);
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

json benchScene(const BenchScene& scene, const TradeoffArguments& a) {
  const std::string name = std::filesystem::path(scene.input).stem().string();
  json out = {{"name", name},
              {"input", scene.input},
              {"environment", scene.environment.empty() ? json(nullptr) : json(scene.environment)},
              {"max_bounces", scene.maxBounces ? json(*scene.maxBounces) : json(nullptr)},
              {"runs", json::array()},
              {"peers", json::array()}};
  // A bad reference is told before minutes of work.
  if (scene.reference != "auto") {
    readReference(scene.reference, a.settings.width, a.settings.height);
  }
  const bool voxels = std::any_of(a.runs.begin(), a.runs.end(),
                                  [](const RenderSettings& s) { return s.exact < 1.0; });
  const auto model = benchModel(scene, a.settings, voxels, out["setup"]);
  const Scorer scorer =
      benchReference(scene, model, a.settings, a.referenceSeconds, out["reference"]);
  out["reference"]["png_base64"] = scorer.referencePng();
  for (const RenderSettings& settings : a.runs) {
    if (interruptedBy() != 0) break;
    out["runs"].push_back(runShare(model, a, settings, scorer, name));
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
              {"machine", benchMachine()},
              {"settings",
               {{"width", a.settings.width},
                {"height", a.settings.height},
                {"seconds", a.seconds},
                {"seed", a.settings.seed},
                {"exact", sharesOf(a)}}},
              {"scenes", json::array()}};
  for (const BenchScene& scene : a.scenes) {
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
