// How the parts of the window are laid out.
#include <fmt/format.h>

#include <algorithm>

#include "src/app/view/handles.h"
#include "src/app/view/panels.h"

namespace trex {
namespace {

constexpr ImGuiWindowFlags kFixed = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                                    ImGuiWindowFlags_NoSavedSettings |
                                    ImGuiWindowFlags_NoBringToFrontOnFocus | ImGuiWindowFlags_NoNav;

/// A window smaller than this shows the picture alone.
constexpr float kLeastWidth = 240.0f, kLeastHeight = 120.0f;

struct Tab {
  Panel panel;
  const char* name;
  void (*draw)(Ui&);
};
constexpr Tab kTabs[] = {
    {Panel::kCamera, "Camera", cameraPanel}, {Panel::kMaterials, "Materials", materialsPanel},
    {Panel::kLights, "Lights", lightsPanel}, {Panel::kObjects, "Objects", objectsPanel},
    {Panel::kView, "View", viewPanel},       {Panel::kSection, "Section", sectionPanel},
    {Panel::kEdits, "Edits", editsPanel},    {Panel::kStatus, "Status", statusPanel},
};

std::string progressText(const Viewer& viewer) {
  const ViewerFigures f = viewer.figures();
  std::string text = fmt::format("{:.1f} samples", f.samplesPerPixel);
  if (f.truthDistance >= 0.0) text += fmt::format("   error {:.3g}", f.truthDistance);
  if (f.exactShare > 0.0) text += fmt::format("   exact {:.0f} %", 100.0 * f.exactShare);
  if (f.converged) text += "   done";
  return text;
}

}  // namespace

void Ui::draw() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const bool small = screen.x < kLeastWidth || screen.y < kLeastHeight;
  if (hidden || small) {
    menuHeight_ = columnWidth_ = bottomHeight_ = 0.0f;
  } else {
    menuBar();
    bottomLine();
    if (shows()) {
      drawHandles(*this);
      column();
    } else {
      columnWidth_ = 0.0f;
    }
  }
  if (!small) {
    if (!shows()) welcome();
    if (help) helpWindow();
    notice();
  }
  drawDivider(*this);
  files.draw();
  questions();
  scrollToSelection = false;
  if (!ImGui::IsAnyItemActive() && !handleHeld()) editor.letGo();
}

bool Ui::pointOnPanel(const vec2& pixel) const {
  const ImGuiIO& io = ImGui::GetIO();
  const vec2 p(pixel.x / io.DisplayFramebufferScale.x, pixel.y / io.DisplayFramebufferScale.y);
  return p.y < menuHeight_ || p.y >= io.DisplaySize.y - bottomHeight_ ||
         p.x >= io.DisplaySize.x - columnWidth_ ||
         (help || files.open() || question != Question::kNothing) || io.WantCaptureMouse;
}

void Ui::menuBar() {
  if (!ImGui::BeginMainMenuBar()) return;
  menuHeight_ = ImGui::GetWindowSize().y;
  const bool there = shows();
  if (ImGui::BeginMenu("File")) {
    if (ImGui::MenuItem("Open...")) askForModel();
    if (ImGui::MenuItem("Save edits", "Ctrl+S", false, there)) saveEdits();
    if (ImGui::MenuItem("Save picture as PNG", "F12", false, there)) savePicture(".png");
    if (ImGui::MenuItem("Save picture as EXR", "Shift+F12", false, there)) savePicture(".exr");
    ImGui::Separator();
    if (ImGui::MenuItem("Close", "Esc")) askToClose();
    ImGui::EndMenu();
  }
  if (ImGui::BeginMenu("Edit", there)) {
    LookHistory& history = viewer.history();
    if (ImGui::MenuItem(("Undo " + history.undoName()).c_str(), "Ctrl+Z", false,
                        history.canUndo())) {
      undo();
    }
    if (ImGui::MenuItem(("Redo " + history.redoName()).c_str(), "Ctrl+Y", false,
                        history.canRedo())) {
      redo();
    }
    ImGui::EndMenu();
  }
  if (ImGui::BeginMenu("Camera", there)) {
    cameraMenu();
    ImGui::EndMenu();
  }
  if (ImGui::BeginMenu("View", there)) {
    const auto& names = viewModeNames();
    ViewState& state = viewer.state();
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto mode = static_cast<ViewMode>(i);
      if (ImGui::MenuItem(names[i].c_str(), nullptr, state.mode == mode)) state.mode = mode;
    }
    ImGui::Separator();
    ImGui::MenuItem("Compare with exact", "B", &state.split);
    ImGui::MenuItem("Pause", "P", &state.paused);
    if (ImGui::MenuItem("Restart", "R")) restart();
    if (ImGui::MenuItem("Hide panels", "Tab")) hidden = true;
    ImGui::EndMenu();
  }
  if (ImGui::BeginMenu("Help")) {
    ImGui::MenuItem("Keys and mouse", "H", &help);
    ImGui::EndMenu();
  }
  ImGui::EndMainMenuBar();
}

void Ui::cameraMenu() {
  if (ImGui::MenuItem("Frame all or selected", "F")) frameAll();
  if (ImGui::MenuItem("Copy", "Ctrl+C")) copyCamera();
  if (ImGui::MenuItem("Paste", "Ctrl+V")) pasteCamera();
  if (ImGui::MenuItem("Bookmark this view")) addBookmark();
  ImGui::Separator();
  const auto& cameras = viewer.scene().cameras;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    const std::string key = i < 9 ? std::to_string(i + 1) : "";
    if (ImGui::MenuItem(shownName(cameras[i].name, "camera", i).c_str(), key.c_str())) {
      goToCamera(i);
    }
    ImGui::PopID();
  }
}

void Ui::column() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const float em = ImGui::GetFontSize();
  columnWidth_ = std::min(std::max(22.0f * em, 0.24f * screen.x), 0.46f * screen.x);
  ImGui::SetNextWindowPos(ImVec2(screen.x - columnWidth_, menuHeight_));
  ImGui::SetNextWindowSize(ImVec2(columnWidth_, screen.y - menuHeight_ - bottomHeight_));
  if (ImGui::Begin("column", nullptr, kFixed)) {
    tabs();
    ImGui::BeginChild("panel", ImVec2(0.0f, 0.0f));
    for (const Tab& tab : kTabs) {
      if (tab.panel == panel) tab.draw(*this);
    }
    ImGui::EndChild();
  }
  ImGui::End();
}

void Ui::tabs() {
  constexpr int kPerRow = 4;
  const float gap = 2.0f;
  ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, ImVec2(gap, gap));
  const float width = (ImGui::GetContentRegionAvail().x - gap * (kPerRow - 1)) / kPerRow;
  int number = 0;
  for (const Tab& tab : kTabs) {
    const bool selected = tab.panel == panel;
    if (selected) ImGui::PushStyleColor(ImGuiCol_Button, ImGui::GetStyleColorVec4(ImGuiCol_Header));
    ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(1.0f, ImGui::GetStyle().FramePadding.y));
    if (ImGui::Button(tab.name, ImVec2(width, 0.0f))) panel = tab.panel;
    ImGui::PopStyleVar();
    if (selected) ImGui::PopStyleColor();
    if (++number % kPerRow != 0) ImGui::SameLine();
  }
  ImGui::PopStyleVar();
  ImGui::Spacing();
}

void Ui::bottomLine() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  bottomHeight_ = ImGui::GetTextLineHeight() + 6.0f;
  ImGui::SetNextWindowPos(ImVec2(0.0f, screen.y - bottomHeight_));
  ImGui::SetNextWindowSize(ImVec2(screen.x, bottomHeight_));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(8.0f, 3.0f));
  ImGui::PushStyleVar(ImGuiStyleVar_WindowMinSize, ImVec2(1.0f, 1.0f));
  if (ImGui::Begin("bottom", nullptr, kFixed)) {
    std::string text = shows() ? progressText(viewer) : "";
    if (shows() && viewer.state().paused) text += "   paused";
    if (shows() && viewer.unsavedEdits()) text += "   unsaved edits";
    if (const std::string message = viewer.message(); !message.empty() && shows()) {
      text += "   " + message;
    }
    ImGui::TextUnformatted(text.c_str());
    const char* hint = "H: keys";
    ImGui::SameLine(screen.x - ImGui::CalcTextSize(hint).x - 10.0f);
    ImGui::TextDisabled("%s", hint);
  }
  ImGui::End();
  ImGui::PopStyleVar(2);
}

void Ui::notice() {
  if (notice_.empty()) return;
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(
      ImVec2(0.5f * (screen.x - columnWidth_), screen.y - bottomHeight_ - 10.0f), ImGuiCond_Always,
      ImVec2(0.5f, 1.0f));
  ImGui::SetNextWindowSizeConstraints(ImVec2(0.0f, 0.0f),
                                      ImVec2(0.9f * (screen.x - columnWidth_), 200.0f));
  ImGui::Begin("notice", nullptr,
               kFixed | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs |
                   ImGuiWindowFlags_NoFocusOnAppearing);
  ImGui::PushTextWrapPos(36.0f * ImGui::GetFontSize());
  ImGui::TextUnformatted(notice_.c_str());
  ImGui::PopTextWrapPos();
  ImGui::End();
}

void Ui::welcome() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(0.5f * screen.x, 0.5f * screen.y), ImGuiCond_Always,
                          ImVec2(0.5f, 0.5f));
  ImGui::Begin("welcome", nullptr,
               kFixed | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoBackground);
  ImGui::PushTextWrapPos(std::min(0.8f * screen.x, 40.0f * ImGui::GetFontSize()));
  switch (viewer.phase()) {
    case OpenPhase::kEmpty:
      ImGui::TextUnformatted("Drop a model here: .glb .gltf .ply .obj .trex");
      if (!hidden && ImGui::Button("Open...")) askForModel();
      break;
    case OpenPhase::kFailed:
      ImGui::TextUnformatted(viewer.message().c_str());
      if (!hidden && ImGui::Button("Open another...")) askForModel();
      break;
    default:
      ImGui::Text("Opening %s", viewer.input().filename().string().c_str());
      if (!viewer.message().empty()) weakText(viewer.message());
  }
  ImGui::PopTextWrapPos();
  ImGui::End();
}

}  // namespace trex
