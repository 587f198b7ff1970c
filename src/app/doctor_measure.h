// trex doctor --measure: the device graph of this machine, kept below the state folder.
#pragma once

#include <filesystem>

#include "src/schedule/machine_record.h"

namespace trex {

/// Measures, keeps it whole or not at all, and reads it back. `picture`: .svg of the graph, or
/// empty. Throws Error.
schedule::MachineRecord measureAndKeep(const std::filesystem::path& picture);
/// On stdout.
void printRecord(const schedule::MachineRecord& record);

}  // namespace trex
