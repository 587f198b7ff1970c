// Texts of the command line that several commands read.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "src/scene/import.h"
#include "src/session/settings.h"

namespace trex {

/// "WxH" with 1 <= W, H <= 65536; Error(kUsage) else.
void parseSize(const std::string& text, std::uint32_t& width, std::uint32_t& height);
/// "512M", "8G", "1.5G", or plain bytes; Error(kUsage) else, which names `option`.
std::uint64_t parseBytes(const char* option, const std::string& text);
/// RenderSettings::device of a number, "auto" or "none"; Error(kUsage) else.
int parseDevice(const std::string& text);
/// Sets the share of exact samples to "auto" or 0 to 1; Error(kUsage) else.
void setExact(const std::string& text, RenderSettings& settings);
/// Adds --exact, and sets its default, auto.
void addExact(CLI::App& command, RenderSettings& settings);
/// Sets the guess: auto, ray, cone, or a share of cones, 0 to 1; Error(kUsage) else.
void setGuess(const std::string& text, RenderSettings& settings);
/// Adds --guess.
void addGuess(CLI::App& command, RenderSettings& settings);
/// Adds what decides how a model is read: --strict, --unit, --up,
/// --scene, --variant, --animation and --at.
void addImportOptions(CLI::App& command, ImportOptions& options);
/// --max-bounces alone.
void addMaxBounces(CLI::App& command, ImportOptions& options);
/// Adds --denoise.
void addDenoise(CLI::App& command, Denoise& denoise);
/// Adds --photon-bounces.
void addPhotonBounces(CLI::App& command, PhotonKind& kind);

}  // namespace trex
