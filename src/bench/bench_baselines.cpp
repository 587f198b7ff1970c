#include "src/bench/bench_baselines.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <vector>

#include "src/bench/photon_map.h"
#include "src/command/interrupt.h"
#include "src/core/clock.h"
#include "src/core/log.h"
#include "src/paths/path_tracer.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

using nlohmann::json;

/// Mean of the samples so far.
class Picture {
 public:
  Picture(std::uint32_t width, std::uint32_t height)
      : width_(width), height_(height), sums_(std::size_t{width} * height, dvec3(0.0)) {}

  std::uint32_t samples() const { return samples_; }

  /// One more sample of each pixel.
  void add(const PathTracer& tracer) {
    tbb::parallel_for(std::uint32_t{0}, height_, [&](std::uint32_t y) {
      std::vector<PathJob> jobs(width_);
      for (std::uint32_t x = 0; x < width_; ++x) jobs[x] = {.x = x, .y = y, .sample = samples_};
      std::vector<PathSample> paths(width_);
      std::vector<RayCounts> counts(width_);
      Cones cones;
      tracer.trace(jobs, width_, 0, paths, counts, cones);
      for (std::uint32_t x = 0; x < width_; ++x) {
        const vec3 light = paths[x].common + paths[x].guess;
        if (isFinite(light)) sums_[std::size_t{y} * width_ + x] += dvec3(light);
      }
    });
    ++samples_;
  }

  ColorImage image() const {
    ColorImage out{width_, height_, {}};
    out.pixels.reserve(sums_.size());
    for (const dvec3& sum : sums_) out.pixels.push_back(vec3(sum / double(std::max(samples_, 1u))));
    return out;
  }

 private:
  std::uint32_t width_, height_, samples_ = 0;
  std::vector<dvec3> sums_;
};

void tell(const std::string& name, const json& point) {
  logInfo("{}: {:.2f} s, {} samples, relMSE {:.4g}, FLIP {:.4f}", name,
          point["seconds"].get<double>(), point["samples"].get<std::uint32_t>(),
          point["relmse"].get<double>(), point["flip"].get<double>());
}

json scored(const Scorer& scorer, ColorImage image, double seconds, std::uint32_t samples) {
  json point = scorer.score(std::move(image));
  point["seconds"] = seconds;
  point["samples"] = samples;
  return point;
}

json photonMapping(const Model& model, const BaselineArguments& a, const Scorer& scorer) {
  const RenderSettings& s = a.settings;
  double taken = 0.0, mark = secondsNow();
  const LightSet lights(model.scene, *model.rays);
  const WalkTracer walks(*model.rays);
  const auto landed = landPhotons(model.scene, walks, lights, s.seed, 0, a.photons, true);
  const PhotonMap map(*landed, a.photons, a.nearest);
  const double photonSeconds = secondsNow() - mark;
  const CameraRays camera(model.scene.cameras.front(), model.rays->renderOrigin(), s.width,
                          s.height);
  GuessOptions guess;
  guess.cache = &map;
  const PathTracer tracer(model.scene, *model.rays, lights, camera, guess, s.seed);
  json run = {{"name", "photons"},
              {"photons", a.photons},
              {"photons_stored", map.photons()},
              {"nearest", a.nearest},
              {"photon_seconds", photonSeconds},
              {"map_bytes", map.bytes()},
              {"points", json::array()}};
  Picture picture(s.width, s.height);
  for (BenchPoints points(a.seconds); interruptedBy() == 0;) {
    do {
      picture.add(tracer);
    } while (taken + secondsNow() - mark < points.next() && interruptedBy() == 0);
    taken += secondsNow() - mark;
    run["points"].push_back(scored(scorer, picture.image(), taken, picture.samples()));
    tell("photon mapping", run["points"].back());
    if (!points.goOn(taken)) break;
    mark = secondsNow();
  }
  return run;
}

json ours(const std::shared_ptr<const Model>& model, const BaselineArguments& a, bool device,
          const Scorer& scorer, bool& sharesCores) {
  RenderSettings settings = a.settings;
  if (!device) settings.device = RenderSettings::kNoDevice;
  Session session(model, model->scene.cameras.front(), settings);
  json run = {{"name", device ? "device" : "cpu"}, {"points", json::array()}};
  for (BenchPoints points(a.seconds); interruptedBy() == 0;) {
    runUntil(session, points.next());
    if (session.samplesDone() == 0) break;
    const ColorImage image = colorsOf(session.picture(), "picture");
    const double seconds = session.report().renderSeconds;
    run["points"].push_back(scored(scorer, image, seconds, session.samplesDone()));
    tell(device ? "with the device" : "without a device", run["points"].back());
    if (!points.goOn(seconds)) break;
  }
  const SessionReport r = session.report();
  run["device"] = r.device;
  run["photons"] = r.photons;
  sharesCores = r.deviceSharesCores;
  return run;
}

/// The seconds at which a curve of points reaches a relMSE, along straight lines between the
/// logarithms; at its first point where it is there from the start. NaN: not reached.
double secondsToRelmse(const json& points, double relmse) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double error = points[i].at("relmse");
    if (error > relmse) continue;
    const double seconds = points[i].at("seconds");
    if (i == 0) return seconds;
    const double errorBefore = points[i - 1].at("relmse");
    const double before = points[i - 1].at("seconds");
    const double way =
        error > 0.0 ? std::log(errorBefore / relmse) / std::log(errorBefore / error) : 1.0;
    return before * std::pow(seconds / before, way);
  }
  return std::numeric_limits<double>::quiet_NaN();
}

/// Of the seconds to the error that all runs have reached.
json ratiosOf(const json& runs, double relmse) {
  const auto seconds = [&](std::size_t i) { return secondsToRelmse(runs[i]["points"], relmse); };
  json out;
  out["photons_over_cpu"] = seconds(0) / seconds(1);
  if (runs.size() > 2) {
    out["cpu_over_device"] = seconds(1) / seconds(2);
    out["photons_over_device"] = seconds(0) / seconds(2);
  }
  return out;
}

}  // namespace

json benchBaselines(const BaselineArguments& a) {
  json out = {{"bench", "baselines"},
              {"machine", benchMachine()},
              {"settings",
               {{"width", a.settings.width},
                {"height", a.settings.height},
                {"seconds", a.seconds},
                {"seed", a.settings.seed},
                {"exact", exactText(a.settings)}}},
              {"input", a.scene.input},
              {"environment", a.scene.environment},
              {"runs", json::array()}};
  if (a.scene.reference != "auto") {
    readReference(a.scene.reference, a.settings.width, a.settings.height);
  }
  const auto model = benchModel(a.scene, a.settings, true, out["setup"]);
  const Scorer scorer =
      benchReference(a.scene, model, a.settings, a.referenceSeconds, out["reference"]);
  out["runs"].push_back(photonMapping(*model, a, scorer));
  bool sharesCores = false;
  if (interruptedBy() == 0) out["runs"].push_back(ours(model, a, false, scorer, sharesCores));
  if (interruptedBy() == 0 && a.settings.device != RenderSettings::kNoDevice) {
    json run = ours(model, a, true, scorer, sharesCores);
    out["machine"]["device"] = run["device"];
    if (run["device"] != "none") {
      out["runs"].push_back(std::move(run));
      out["device_shares_cores"] = sharesCores;
    }
  }
  double common = 0.0;
  for (const json& run : out["runs"]) {
    if (run["points"].empty()) return out;
    common = std::max(common, run["points"].back()["relmse"].get<double>());
  }
  out["common_relmse"] = common;
  if (out["runs"].size() > 1) out["ratios"] = ratiosOf(out["runs"], common);
  return out;
}

}  // namespace trex
