// trex bench: a command of src/app/main.cpp; one file a subcommand.
#pragma once

#include <CLI/CLI.hpp>

namespace trex {

/// Adds `trex bench`. Its exit code, 0, 130 or 143, is written to `exitCode`.
void addBenchCommand(CLI::App& app, int& exitCode);
/// Adds `trex bench baselines`; its exit code as above.
void addBenchBaselinesCommand(CLI::App& bench, int& exitCode);
/// Adds `trex bench asvo`.
void addBenchAsvoCommand(CLI::App& bench);
/// Adds `trex bench schedule`.
void addBenchScheduleCommand(CLI::App& bench);

}  // namespace trex
