#include "src/app/view/look_editor.h"

namespace trex {

void LookEditor::change(const Look& look, const std::string& what) {
  if (look == viewer_.look()) return;
  what_ = what;
  viewer_.edit(look, false, what);
}

void LookEditor::commit(const Look& look, const std::string& what) {
  letGo();
  if (look == viewer_.look()) return;
  viewer_.edit(look, true, what);
}

void LookEditor::changeView(const Look& look) {
  if (look == viewer_.look()) return;
  viewer_.edit(look, false, what_.empty() ? "View" : what_);
}

void LookEditor::letGo() {
  if (what_.empty()) return;
  viewer_.edit(Look(viewer_.look()), true, what_);
  what_.clear();
}

}  // namespace trex
