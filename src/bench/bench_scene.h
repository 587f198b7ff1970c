// What benches of whole pictures share: the machine, a scene made ready, a reference of our own,
// and points in time.
#pragma once

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "src/bench/bench_score.h"
#include "src/session/session.h"

namespace trex {

/// One scene of a bench.
struct BenchScene {
  std::string input;  ///< model file
  /// Picture file, or "auto": rendered by the exact mode, another seed.
  std::string reference = "auto";
  std::string environment;                    ///< as of `trex render --env`; empty: the scene's
  std::optional<std::uint32_t> maxBounces{};  ///< instead of the file's
};

/// {"cpu", "threads", "cores", "device": "none", "version"}.
nlohmann::json benchMachine();

/// The first camera's model, with voxels for pictures of that size if they are wanted; `setup` gets
/// import_seconds, mesh_build_seconds, voxel_build_seconds and triangles. Throws Error.
std::shared_ptr<const Model> benchModel(const BenchScene& scene, const RenderSettings& settings,
                                        bool voxels, nlohmann::json& setup);

/// The scene's reference for pictures of these settings: its file, else so many seconds of the
/// exact mode. `told` gets "file" and, of our own, "seconds" and "samples". Throws Error.
Scorer benchReference(const BenchScene& scene, const std::shared_ptr<const Model>& model,
                      const RenderSettings& settings, double seconds, nlohmann::json& told);

/// Runs until `seconds` of rendering in all; the first pass is finished in any case. An interrupt
/// ends it.
void runUntil(Session& session, double seconds);

/// Seconds at which pictures are scored: 0.0625, 0.125, 0.25, ... and the last.
class BenchPoints {
 public:
  explicit BenchPoints(double seconds) : seconds_(seconds) {}
  double next() const { return std::min(next_, seconds_); }
  /// The picture was ready after `taken` seconds. False if that was the last one.
  bool goOn(double taken);

 private:
  double seconds_, next_ = 0.0625;
};

}  // namespace trex
