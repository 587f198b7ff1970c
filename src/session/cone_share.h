// The share of samples that `--guess auto` gathers by cones.
#pragma once

#include <string>

#include "src/schedule/machine_record.h"

namespace trex {

/// A device with cores of its own takes as much of the gathering as it can while the processors
/// trace the rest of the paths: what schedule::jobsForDevice() says of the times that were measured
/// of this machine, and all of it where `machine` is null or does not know the device. Where the
/// device is the processors' own cores it is 0: rays into cached light are better there
/// (docs/schedule.md). It is in steps of 1/64, and depends on nothing that happens while rendering.
/// Thread safe.
double autoConeShare(const schedule::MachineRecord* machine, const std::string& device,
                     bool sharesHostCores);

}  // namespace trex
