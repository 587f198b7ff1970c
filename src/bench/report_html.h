// The document of `trex bench tradeoff` as a page and as charts.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace trex {

/// Error over time of one scene of the document, peers dashed: relMSE on logarithmic axes, or FLIP
/// over a logarithmic time. `metric` is "relmse" or "flip".
std::string tradeoffSvg(const nlohmann::json& scene, const std::string& metric);

/// A page that needs nothing else: no scripts, no other files. Throws nlohmann::json::exception if
/// the document lacks what benchTradeoff writes.
std::string tradeoffHtml(const nlohmann::json& document);

}  // namespace trex
