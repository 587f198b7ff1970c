// The main loop of the window, one thread:
//
//   take input ─► step of the viewer, within the budget ─► panels ─► present
//
// Nothing is drawn while nothing changes: the loop then sleeps until there is input.
#pragma once

#include <algorithm>

#include "src/app/view/input.h"
#include "src/app/view/ui.h"
#include "src/app/view/window.h"
#include "src/viewer/viewer.h"

namespace trex {

/// What one turn of the loop did.
struct Turn {
  StepReport step;
  bool presented = false;
  double seconds = 0.0;      ///< of the turn, sleep excluded
  double drawSeconds = 0.0;  ///< of it, panels and present
};

class ViewLoop {
 public:
  ViewLoop(Viewer& viewer, Window& window, Ui& ui, double budgetSeconds, int scale);

  /// Sleeps if there is nothing to do and `maySleep`, then does one turn. Throws Error.
  Turn turn(bool maySleep);
  /// Draws in the next turn, whether anything has changed or not.
  void drawNext() { framesToDraw_ = std::max(framesToDraw_, 1); }
  /// Draws now, without a step of the viewer.
  void drawOnly() { draw(); }
  /// Until the window is closed or a signal came. Returns 0 or the signal's exit code.
  int run();

 private:
  double pause(bool maySleep) const;
  bool drawsNow(const StepReport& step);
  void draw();

  Viewer& viewer_;
  Window& window_;
  Ui& ui_;
  Input input_;
  double budget_;
  std::uint32_t scale_;
  double drawCost_ = 0.0;  ///< seconds, running mean
  double lastTurn_ = 0.0, lastDraw_ = 0.0;
  int framesToDraw_ = 3;
  bool idled_ = false;  ///< the last step had nothing to do
};

}  // namespace trex
