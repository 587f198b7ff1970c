// How the panels look.
#pragma once

namespace trex {

/// Sets colours, spacing and font of the current ImGui context; `scale` from the display.
void applyStyle(float scale);

}  // namespace trex
