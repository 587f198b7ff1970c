// What is drawn into the picture and can be dragged there: lights with three axes, the divider of
// the split view. Positions are pixels of the picture unless said otherwise.
#pragma once

#include "src/app/view/ui.h"

namespace trex {

/// Marks of all lights while the lights are shown, axes of the selected one.
void drawHandles(Ui& ui);
void drawDivider(Ui& ui);

/// The light whose mark is at this pixel, or kNone.
int lightAt(Ui& ui, const vec2& pixel);

/// Takes hold of what is at this pixel; false if there is nothing.
bool holdHandle(Ui& ui, const vec2& pixel);
/// Moves what is held with the pointer.
void dragHandle(Ui& ui, const vec2& from, const vec2& to);
void releaseHandle();
bool handleHeld();

}  // namespace trex
