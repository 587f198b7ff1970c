// What `trex doctor --measure` kept of this machine.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "src/schedule/machine_record.h"
#include "src/session/settings.h"

namespace trex {

/// machine.json in stateFolder(); empty if there is no home.
std::filesystem::path machineRecordPath();
/// What was kept; nothing if there is none. Throws Error(kInput) if it can't be used.
std::optional<schedule::MachineRecord> keptMachineRecord();
/// The same for a render of these settings, where it has a use: null, and a warning, if it can't be
/// used.
std::shared_ptr<const schedule::MachineRecord> measuredMachine(const RenderSettings& settings);

}  // namespace trex
