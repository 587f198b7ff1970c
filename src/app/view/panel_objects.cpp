#include <fmt/format.h>

#include <algorithm>

#include "src/app/view/panels.h"
#include "src/viewer/visibility.h"

namespace trex {
namespace {

void underPointer(Ui& ui) {
  std::string text = "Under the pointer: ";
  const auto hit = ui.pointer ? ui.viewer.pick(ui.pointer->x, ui.pointer->y) : std::nullopt;
  if (hit) {
    text += shownName(ui.viewer.scene().objects[hit->object], "object", hit->object);
  } else {
    text += "nothing";
  }
  weakText(text);
}

void buttons(Ui& ui) {
  const int selected = ui.viewer.state().selectedObject;
  const Look& now = ui.viewer.look();
  const auto count = static_cast<std::uint32_t>(ui.viewer.scene().objects.size());
  ImGui::BeginDisabled(selected == kNone);
  const auto object = static_cast<std::uint32_t>(std::max(selected, 0));
  if (ImGui::Button(isHidden(now, object) ? "Show" : "Hide")) {
    Look look = now;
    setHidden(look, object, !isHidden(now, object));
    ui.editor.commit(look, isHidden(now, object) ? "Show object" : "Hide object");
  }
  ImGui::SameLine();
  if (ImGui::Button("Isolate")) {
    Look look = now;
    isolate(look, object, count);
    ui.editor.commit(look, "Isolate object");
  }
  tip("Hides everything else");
  ImGui::EndDisabled();
  ImGui::SameLine();
  ImGui::BeginDisabled(now.hidden.empty());
  if (ImGui::Button("Show all")) {
    Look look = now;
    look.hidden.clear();
    ui.editor.commit(look, "Show all");
  }
  ImGui::EndDisabled();
}

void objectRow(Ui& ui, std::size_t i) {
  const auto object = static_cast<std::uint32_t>(i);
  bool visible = !isHidden(ui.viewer.look(), object);
  ImGui::PushID(static_cast<int>(i));
  if (ImGui::Checkbox("##visible", &visible)) {
    Look look = ui.viewer.look();
    setHidden(look, object, !visible);
    ui.editor.commit(look, visible ? "Show object" : "Hide object");
  }
  tip("Visible");
  ImGui::SameLine();
  const bool selected = ui.viewer.state().selectedObject == static_cast<int>(i);
  const std::string name = shownName(ui.viewer.scene().objects[i], "object", i);
  if (ImGui::Selectable(name.c_str(), selected)) {
    ui.selectObject(selected ? kNone : static_cast<int>(i));
  }
  if (selected && ui.scrollToSelection) ImGui::SetScrollHereY();
  ImGui::PopID();
}

}  // namespace

void objectsPanel(Ui& ui) {
  searchBox("Search objects", ui.objectSearch);
  buttons(ui);
  underPointer(ui);
  const auto& objects = ui.viewer.scene().objects;
  std::vector<int> rows;
  int selectedRow = kNone;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (!matches(shownName(objects[i], "object", i), ui.objectSearch)) continue;
    if (ui.viewer.state().selectedObject == static_cast<int>(i)) {
      selectedRow = static_cast<int>(rows.size());
    }
    rows.push_back(static_cast<int>(i));
  }
  ImGui::BeginChild("objects", ImVec2(0.0f, 0.0f), true);
  // Models of CAD have many thousands: only the rows in view are made.
  ImGuiListClipper clipper;
  clipper.Begin(static_cast<int>(rows.size()));
  if (ui.scrollToSelection && selectedRow != kNone) {
    clipper.ForceDisplayRangeByIndices(selectedRow, selectedRow + 1);
  }
  while (clipper.Step()) {
    for (int row = clipper.DisplayStart; row < clipper.DisplayEnd; ++row) {
      objectRow(ui, static_cast<std::size_t>(rows[static_cast<std::size_t>(row)]));
    }
  }
  ImGui::EndChild();
}

}  // namespace trex
