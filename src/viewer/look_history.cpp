// A step of undo is either one of edits or one of the camera and exposure alone. With a step of
// edits, moves of the camera before it do not count: undoing it leaves the camera where it is.
#include "src/viewer/look_history.h"

#include <algorithm>
#include <utility>

namespace trex {
namespace {

void takeView(Look& look, const Look& from) {
  look.camera = from.camera;
  look.exposure = from.exposure;
}

/// Whether two looks differ in more than camera and exposure.
bool editsDiffer(const Look& a, const Look& b) {
  Look sameView = b;
  takeView(sameView, a);
  return !(a == sameView);
}

}  // namespace

LookHistory::LookHistory(Look start) : current_(std::move(start)), saved_(current_) {
  steps_.push_back({current_, ""});
}

void LookHistory::set(const Look& look, bool commit, const std::string& what) {
  current_ = look;
  const bool edited = editsDiffer(current_, steps_[at_].look);
  pending_ = edited && !commit;
  if (!commit || current_ == steps_[at_].look) return;
  if (edited) takeView(steps_[at_].look, current_);
  steps_.resize(at_ + 1);
  steps_.push_back({current_, what});
  if (steps_.size() > kMostSteps + 1) steps_.erase(steps_.begin());
  at_ = steps_.size() - 1;
}

std::string LookHistory::undoName() const {
  if (pending_) return "the change under way";
  return at_ > 0 ? steps_[at_].what : "";
}

std::string LookHistory::redoName() const { return canRedo() ? steps_[at_ + 1].what : ""; }

const Look& LookHistory::undo() {
  if (!canUndo()) return current_;
  Look before = steps_[pending_ ? at_ : at_ - 1].look;
  if (editsDiffer(before, current_)) takeView(before, current_);
  if (!pending_) --at_;
  pending_ = false;
  current_ = std::move(before);
  return current_;
}

const Look& LookHistory::redo() {
  if (!canRedo()) return current_;
  Look after = steps_[++at_].look;
  if (editsDiffer(after, current_)) takeView(after, current_);
  current_ = std::move(after);
  return current_;
}

bool LookHistory::unsaved() const { return editsDiffer(current_, saved_); }

void LookHistory::markSaved() { saved_ = current_; }

}  // namespace trex
