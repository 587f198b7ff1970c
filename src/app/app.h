// The subcommands; one file each. Each adds itself to the command line and runs if it was named.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "src/scene/import.h"
#include "src/session/settings.h"

namespace trex {

/// Adds `trex render`. The returned callback's exit code is written to `exitCode`.
void addRenderCommand(CLI::App& app, int& exitCode);
/// Adds `trex bake`.
void addBakeCommand(CLI::App& app);
/// Adds `trex info`.
void addInfoCommand(CLI::App& app);
/// Adds `trex doctor`.
void addDoctorCommand(CLI::App& app);
/// Adds `trex diff`. Its exit code, 0 or 6, is written to `exitCode`.
void addDiffCommand(CLI::App& app, int& exitCode);
/// Adds `trex export-vdb`.
void addExportVdbCommand(CLI::App& app);
/// Adds `trex merge`.
void addMergeCommand(CLI::App& app);
/// Adds `trex bench`. Its exit code, 0, 130 or 143, is written to `exitCode`.
void addBenchCommand(CLI::App& app, int& exitCode);
/// Adds `trex bench asvo`.
void addBenchAsvoCommand(CLI::App& bench);

/// Adds `trex view`, which becomes the program trex-view with the arguments of this one.
void addViewCommand(CLI::App& app, int argc, char** argv);

/// "WxH" with 1 <= W, H <= 65536; Error(kUsage) else.
void parseSize(const std::string& text, std::uint32_t& width, std::uint32_t& height);
/// "512M", "8G", "1.5G", or plain bytes; Error(kUsage) else.
std::uint64_t parseBytes(const std::string& text);
/// RenderSettings::device of a number, "auto" or "none"; Error(kUsage) else.
int parseDevice(const std::string& text);
/// Adds what decides how a model is read: --strict, --unit, --up,
/// --scene, --variant, --animation and --at.
void addImportOptions(CLI::App& command, ImportOptions& options);
/// Adds --photon-bounces.
void addPhotonBounces(CLI::App& command, PhotonKind& kind);

}  // namespace trex
