// Speed against accuracy: error over time for several shares of exact samples.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "src/bench/bench_scene.h"
#include "src/session/settings.h"

namespace trex {

struct TradeoffArguments {
  std::vector<BenchScene> scenes;
  std::vector<RenderSettings> runs;  ///< `settings`, each with its share of exact samples
  double seconds = 60.0;             ///< of each run
  double referenceSeconds = 0.0;
  RenderSettings settings;  ///< size, seed, device, guess, filter; the rest is set here
};

/// Renders every scene with every share. A run stops at 0.0625, 0.125, 0.25, ... seconds, is scored
/// and goes on; scoring does not count as time, the filter of each picture does. Scores are those
/// of compareImages, relMSE without the largest 0.1 % of its terms; where NAME.clean.exr lies
/// beside the reference NAME.exr, FLIP is taken against it. An interrupt ends the bench with what
/// is done.
///
/// The document: {"bench": "tradeoff", "machine": {..}, "settings": {..}, "scenes": [{"name",
/// "input", "environment", "max_bounces", "reference": {..}, "setup": {..}, "runs": [{"exact" (or
/// "auto"), "points": [{"seconds", "samples", "relmse", "flip", "mean_ratio", ..}], "slope", ..}],
/// "peers": []}]}.
/// `sceneDone` gets the document after each scene. Throws Error.
nlohmann::json benchTradeoff(const TradeoffArguments& arguments,
                             const std::function<void(const nlohmann::json&)>& sceneDone);

/// Exponent s of error ~ seconds^s, fitted to the logarithms of the last half of the points; null
/// for fewer than two of them or an error that is not positive. Unbiased sampling has -1.
nlohmann::json slopeOf(const nlohmann::json& points);

/// The share of exact samples of a run in such a document: a number, or auto.
std::string shareText(const nlohmann::json& run);

}  // namespace trex
