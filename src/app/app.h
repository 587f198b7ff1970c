// The subcommands; one file each. Each adds itself to the command line and runs if it was named.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

namespace trex {

/// Adds `trex render`. The returned callback's exit code is written to `exitCode`.
void addRenderCommand(CLI::App& app, int& exitCode);
/// Adds `trex doctor`.
void addDoctorCommand(CLI::App& app);

/// "WxH" with 1 <= W, H <= 65536; Error(kUsage) else.
void parseSize(const std::string& text, std::uint32_t& width, std::uint32_t& height);
/// "512M", "8G", "1.5G", or plain bytes; Error(kUsage) else.
std::uint64_t parseBytes(const std::string& text);

}  // namespace trex
