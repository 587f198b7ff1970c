#include <fmt/format.h>

#include "src/app/view/panels.h"
#include "src/scene/import.h"

namespace trex {
namespace {

void listCameras(Ui& ui) {
  heading("Cameras of the file");
  const auto& cameras = ui.viewer.scene().cameras;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const std::string name = fmt::format("{}{}##camera{}", i < 9 ? fmt::format("{}  ", i + 1) : "",
                                         shownName(cameras[i].name, "camera", i), i);
    if (ImGui::Selectable(name.c_str(), cameras[i] == ui.viewer.look().camera)) ui.goToCamera(i);
  }
}

void listBookmarks(Ui& ui) {
  heading("Bookmarks");
  std::size_t removed = ui.bookmarks.size();
  for (std::size_t i = 0; i < ui.bookmarks.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::SmallButton("x")) removed = i;
    tip("Remove this bookmark");
    ImGui::SameLine();
    if (ImGui::Selectable(ui.bookmarks[i].name.c_str())) {
      ui.attempt([&] { ui.setCamera(parseCamera(ui.bookmarks[i].camera, ui.viewer.scene())); });
    }
    ImGui::PopID();
  }
  if (removed < ui.bookmarks.size()) {
    ui.bookmarks.erase(ui.bookmarks.begin() + static_cast<std::ptrdiff_t>(removed));
    ui.attempt([&] { writeBookmarks(bookmarksFile(ui.viewer.input()), ui.bookmarks); });
  }
  if (ImGui::Button("Add this view")) ui.addBookmark();
}

/// Depth of field; a new lens is focused on the pivot.
void lens(Ui& ui) {
  Camera c = ui.viewer.look().camera;
  if (c.orthographic) return;
  bool wanted = c.fstop > 0.0f, changed = false;
  if (checkBox("Depth of field", wanted, "A lens before a sensor 24 mm high")) {
    c.fstop = wanted ? 2.8f : 0.0f;
    c.focus = wanted ? static_cast<float>(glm::length(ui.camera->pivot() - c.eye)) : 0.0f;
    changed = true;
  }
  if (wanted) {
    const auto size = static_cast<float>(ui.camera->sceneSize());
    changed |= slider("f-number", c.fstop, 0.05f, 32.0f, "%.2f", true, "Smaller: more blur");
    changed |= slider("Focus, m", c.focus, 1e-3f * size, 4.0f * size, "%.3f", true,
                      "Along the view, to the plane that is sharp");
  }
  if (changed) ui.setCamera(c);
}

}  // namespace

void cameraPanel(Ui& ui) {
  Look look = ui.viewer.look();
  float degrees = glm::degrees(look.camera.verticalFov);
  if (!look.camera.orthographic &&
      slider("Field of view", degrees, 5.0f, 120.0f, "%.1f\xc2\xb0", false, "Vertical, degrees")) {
    ui.camera->setFieldOfView(glm::radians(degrees));
    ui.moveCamera();
  }
  lens(ui);
  label("Exposure", "Stops; of the screen and of PNG files alone");
  ImGui::SetNextItemWidth(-4.5f * ImGui::GetFontSize());
  if (ImGui::SliderFloat("##exposure", &look.exposure, -10.0f, 10.0f, "%.2f stops")) {
    ui.editor.changeView(look);
  }
  ImGui::SameLine();
  if (ImGui::Button("Auto", ImVec2(-1.0f, 0.0f))) ui.autoExposure();
  tip("The exposure that suits what is shown now");
  dvec3 eye = look.camera.eye;
  if (pointBox("Eye, m", eye, ui.camera->sceneSize())) {
    Camera moved = look.camera;
    moved.eye = eye;
    ui.setCamera(moved);
  }
  ImGui::Spacing();
  if (ImGui::Button("Frame all (F)")) {
    ui.selectObject(kNone);
    ui.frameAll();
  }
  tip("Moves back until everything is in view");
  ImGui::SameLine();
  if (ImGui::Button("Copy")) ui.copyCamera();
  tip("Ctrl+C: the camera as EYE/TARGET/UP/VFOV, which --camera reads");
  ImGui::SameLine();
  if (ImGui::Button("Paste")) ui.pasteCamera();
  tip("Ctrl+V: a camera's name, or EYE/TARGET/UP/VFOV");
  listCameras(ui);
  listBookmarks(ui);
}

}  // namespace trex
