#include <algorithm>

#include "src/app/view/panels.h"

namespace trex {
namespace {

struct Explained {
  ViewMode mode;
  const char* says;
};
constexpr Explained kExplained[] = {
    {ViewMode::kBeauty, "The picture"},
    {ViewMode::kAlbedo, "Colour of the first surface that is no mirror or glass"},
    {ViewMode::kNormal, "Its normal: x, y, z as red, green, blue"},
    {ViewMode::kDepth, "Distance of the first surface"},
    {ViewMode::kVariance, "Where the picture is still noisy"},
    {ViewMode::kSampleCount, "Where the work has gone"},
    {ViewMode::kRayClass, "Orange: exact rays on the CPU; blue: rays through voxels"},
    {ViewMode::kVoxels, "The voxels that far rays see"},
    {ViewMode::kPhotons, "Light that the photons have left in the voxels"},
};

/// By the number of the ToneOperator.
constexpr const char* kOperators[] = {
    "What is brighter than the screen is cut off: hues change there",
    "Khronos PBR Neutral: colours as they are, highlights towards white",
    "AgX: soft and less saturated, for great contrasts",
};

}  // namespace

void viewPanel(Ui& ui) {
  ViewState& state = ui.viewer.state();
  heading("Show");
  const auto& names = viewModeNames();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool selected = state.mode == static_cast<ViewMode>(i);
    if (ImGui::RadioButton(names[i].c_str(), selected)) state.mode = static_cast<ViewMode>(i);
    if (i < std::size(kExplained)) tip(kExplained[i].says);
    if (i % 2 == 0 && i + 1 < names.size()) ImGui::SameLine(0.5f * ImGui::GetWindowWidth());
  }
  if (state.mode == ViewMode::kVoxels) {
    label("Level", "0 is one voxel around everything");
    ImGui::SliderInt("##level", &state.voxelLevel, 0, std::max(ui.viewer.voxelDepth(), 0));
  }
  heading("Highlights");
  for (std::size_t i = 0; i < std::size(kOperators); ++i) {
    const auto op = static_cast<ToneOperator>(i);
    if (ImGui::RadioButton(toneOperatorNames()[i].c_str(), state.toneOperator == op)) {
      state.toneOperator = op;
    }
    tip(kOperators[i]);
    if (i + 1 < std::size(kOperators)) ImGui::SameLine();
  }
  heading("Compare");
  checkBox("Exact mode on the right (B)", state.split,
           "Right of the divider: path tracing alone. Drag the divider in the picture.");
  if (state.split) slider("Divider", state.splitAt, 0.0f, 1.0f, "%.2f");
  heading("Rendering");
  checkBox("Pause (P)", state.paused);
  ImGui::SameLine();
  if (ImGui::Button("Restart (R)")) ui.restart();
  tip("Starts the picture anew");
}

}  // namespace trex
