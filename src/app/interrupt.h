// First interrupt: finish the tile, save, leave with 130 or 143. Second: leave at once.
#pragma once

namespace trex {

/// Installs handlers for SIGINT and SIGTERM.
void catchInterrupts();
/// 0, or the signal that asked to stop.
int interruptedBy();

}  // namespace trex
