// `mpirun -n N trex render ...`: one job of pictures by several machines.
#pragma once

#include "src/command/render_arguments.h"

namespace trex {

/// What each of the N processes does, with its settings read. Returns the exit code: machine 0's is
/// the job's, the others' is 0 once they could tell it what went wrong. Throws Error.
int renderTogether(RenderArguments& a);

}  // namespace trex
