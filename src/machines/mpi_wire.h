// Messages by MPI, whose library is opened only if mpirun started several of this program.
#pragma once

#include <memory>

#include "src/machines/wire.h"

namespace trex::machines {

/// How mpirun started this process, by what it set in the environment; no MPI is asked.
struct Started {
  std::uint32_t rank = 0, size = 1;
};
Started startedAs();

/// Whether this program was built with MPI.
bool hasMpi();
/// "Open MPI v4.1.4". Opens the library; throws Error(kMemoryOrDevice) if it can't be.
std::string mpiLibrary();

/// Whether the job goes on without a process that dies; after openMpiWire().
bool survivesDeaths();
/// After Wire::finish(): processes have died, so that MPI could not be ended as it should, and what
/// it does at this process's end might wait for them: it had better end by _exit().
bool mpiEndsUncleanly();

/// Throws Error(kMemoryOrDevice) if this program was built without MPI or it can't be opened,
/// Error(kFailed) if MPI can't start, or is another one than that of mpirun.
std::unique_ptr<Wire> openMpiWire();

}  // namespace trex::machines
