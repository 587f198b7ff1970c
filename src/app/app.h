// The subcommands; one file each. Each adds itself to the command line and runs if it was named.
#pragma once

#include <CLI/CLI.hpp>

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
/// Adds `trex denoise`.
void addDenoiseCommand(CLI::App& app);
/// Adds `trex merge`.
void addMergeCommand(CLI::App& app);
/// Adds `trex view`, which becomes the program trex-view with the arguments of this one.
void addViewCommand(CLI::App& app, int argc, char** argv);

/// Adds `trex worker`.
void addWorkerCommand(CLI::App& app);

}  // namespace trex
