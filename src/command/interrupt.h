// Signals. First SIGINT or SIGTERM: finish the tile, save, leave with 130 or 143. Second: leave at
// once. SIGHUP: save the picture so far and go on.
#pragma once

namespace trex {

/// Installs the handlers.
void catchInterrupts();
/// 0, or the signal that asked to stop.
int interruptedBy();
/// Whether SIGHUP came since the last call of clearHangup().
bool hangupSeen();
void clearHangup();

}  // namespace trex
