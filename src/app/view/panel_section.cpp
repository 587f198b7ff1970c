#include "src/app/view/panels.h"
#include "src/viewer/visibility.h"

namespace trex {

void sectionPanel(Ui& ui) {
  Look look = ui.viewer.look();
  const Box3d bounds = ui.viewer.bounds();
  bool on = look.section.has_value();
  std::string what;
  if (checkBox("Cut the model open", on)) {
    look.section.reset();
    if (on) look.section = sectionAt(bounds, vec3(1.0f, 0.0f, 0.0f), 0.5);
    what = on ? "Section" : "No section";
  }
  if (!on) {
    weakText("Everything on one side of a plane is cut away, for every ray.");
    if (!what.empty()) ui.editor.commit(look, what);
    return;
  }
  static constexpr const char* kAxes[] = {"X", "Y", "Z"};
  label("Across");
  for (int axis = 0; axis < 3; ++axis) {
    vec3 normal(0.0f);
    normal[axis] = 1.0f;
    if (axis > 0) ImGui::SameLine();
    if (!ImGui::Button(kAxes[axis])) continue;
    look.section = sectionAt(bounds, normal, 0.5);
    what = "Section";
  }
  ImGui::SameLine();
  if (ImGui::Button("From the view")) {
    look.section = sectionAt(bounds, -look.camera.forward, 0.5);
    what = "Section from the view";
  }
  tip("Cuts away what is nearest to you");
  auto share = static_cast<float>(sectionShare(bounds, *look.section));
  if (slider("Depth", share, 0.0f, 1.0f, "%.3f")) {
    look.section = sectionAt(bounds, look.section->normal, share);
    what = "Move the section";
  }
  if (ImGui::Button("Flip")) {
    look.section->normal = -look.section->normal;
    what = "Flip the section";
  }
  tip("Cuts away the other side");
  if (!what.empty()) ui.editor.change(look, what);
}

}  // namespace trex
