// trex doctor --measure: the device graph of this machine, kept below the state folder.
#pragma once

#include <filesystem>
#include <optional>

#include "src/schedule/machine_record.h"

namespace trex {

/// machine.json in stateFolder(); empty if there is no home.
std::filesystem::path machineRecordPath();
/// What was kept; nothing if there is none. Throws Error(kInput) if it can't be used.
std::optional<schedule::MachineRecord> keptMachineRecord();
/// Measures, keeps it whole or not at all, and reads it back. `picture`: .svg of the graph, or
/// empty. Throws Error.
schedule::MachineRecord measureAndKeep(const std::filesystem::path& picture);
/// On stdout.
void printRecord(const schedule::MachineRecord& record);

}  // namespace trex
