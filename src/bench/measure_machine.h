// A short test run that measures this machine: what `trex doctor --measure` keeps.
#pragma once

#include "src/schedule/machine_record.h"

namespace trex {

/// Some seconds of work: a temporary file in $TMPDIR (64 MiB) is written and read again; rays,
/// cones and photons of a generated model are traced in jobs of many sizes by all CPU threads, and
/// cones and photons by the device of `--device auto`, if there is one; buffers are copied to it.
/// Half of the jobs are fitted, the others are predicted. Throws Error(kOutput) if the file can't
/// be written, Error(kMemoryOrDevice) if there is no memory.
schedule::MachineRecord measureMachine();

}  // namespace trex
