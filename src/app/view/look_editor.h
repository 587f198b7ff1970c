// Turns what panels and handles do into edits and steps of undo.
#pragma once

#include <string>

#include "src/viewer/viewer.h"

namespace trex {

class LookEditor {
 public:
  explicit LookEditor(Viewer& viewer) : viewer_(viewer) {}

  /// Shows a change; the step of undo, named `what`, ends in letGo().
  void change(const Look& look, const std::string& what);
  /// Shows a change that is a step of its own.
  void commit(const Look& look, const std::string& what);
  /// Camera and exposure: shown, no step of undo.
  void changeView(const Look& look);
  /// Nothing is held any more: ends the step under way, if there is one.
  void letGo();
  bool underWay() const { return !what_.empty(); }

 private:
  Viewer& viewer_;
  std::string what_;  ///< of the step under way
};

}  // namespace trex
