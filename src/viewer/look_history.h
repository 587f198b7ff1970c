// Undo and redo of looks, and whether there are unsaved edits. Plain data, one thread at a time.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "src/scene/look.h"

namespace trex {

class LookHistory {
 public:
  static constexpr std::size_t kMostSteps = 200;  ///< older ones are forgotten

  explicit LookHistory(Look start);

  const Look& current() const { return current_; }
  /// Shows a look; with `commit` what has changed since the last commit becomes one step.
  void set(const Look& look, bool commit, const std::string& what);
  bool canUndo() const { return at_ > 0 || pending_; }
  bool canRedo() const { return !pending_ && at_ + 1 < steps_.size(); }
  /// What would be undone or redone, for a menu; empty if nothing.
  std::string undoName() const;
  std::string redoName() const;
  const Look& undo();
  const Look& redo();
  /// Camera and exposure alone are no edits that need saving.
  bool unsaved() const;
  void markSaved();

 private:
  struct Step {
    Look look;
    std::string what;
  };
  Look current_;
  std::vector<Step> steps_;  ///< steps_[at_] is the last committed look
  std::size_t at_ = 0;
  bool pending_ = false;  ///< current_ differs from steps_[at_]
  Look saved_;
};

}  // namespace trex
