// The widgets that panels are made of.
#include <fmt/format.h>
#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>
#include <cctype>

#include "src/app/view/panels.h"

namespace trex {

bool matches(std::string_view name, std::string_view search) {
  const auto same = [](unsigned char a, unsigned char b) {
    return std::tolower(a) == std::tolower(b);
  };
  return std::search(name.begin(), name.end(), search.begin(), search.end(), same) != name.end() ||
         search.empty();
}

std::string shownName(const std::string& name, const char* kind, std::size_t number) {
  return name.empty() ? fmt::format("{} {}", kind, number) : name;
}

void tip(const char* text) {
  if (text != nullptr && ImGui::IsItemHovered()) {
    ImGui::BeginTooltip();
    ImGui::PushTextWrapPos(22.0f * ImGui::GetFontSize());
    ImGui::TextUnformatted(text);
    ImGui::PopTextWrapPos();
    ImGui::EndTooltip();
  }
}

void label(const char* text, const char* tipText) {
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted(text);
  tip(tipText);
  ImGui::SameLine(0.36f * ImGui::GetWindowWidth());
  ImGui::SetNextItemWidth(-1.0f);
}

void searchBox(const char* hint, std::string& text) {
  ImGui::SetNextItemWidth(-1.0f);
  ImGui::InputTextWithHint("##search", hint, &text);
}

bool slider(const char* text, float& value, float low, float high, const char* format,
            bool logarithmic, const char* tipText) {
  label(text, tipText);
  ImGui::PushID(text);
  const ImGuiSliderFlags flags = logarithmic ? ImGuiSliderFlags_Logarithmic : 0;
  const bool moved = ImGui::SliderFloat("##slider", &value, low, high, format, flags);
  ImGui::PopID();
  return moved;
}

bool colorBox(const char* text, float* rgb, const char* tipText) {
  label(text, tipText);
  ImGui::PushID(text);
  const bool changed = ImGui::ColorEdit3("##color", rgb,
                                         ImGuiColorEditFlags_Float | ImGuiColorEditFlags_NoOptions |
                                             ImGuiColorEditFlags_PickerHueWheel);
  ImGui::PopID();
  return changed;
}

bool pointBox(const char* text, dvec3& point, double size) {
  label(text);
  ImGui::PushID(text);
  const bool changed =
      ImGui::DragScalarN("##point", ImGuiDataType_Double, &point.x, 3,
                         static_cast<float>(0.001 * size), nullptr, nullptr, "%.3f");
  ImGui::PopID();
  return changed;
}

bool checkBox(const char* text, bool& value, const char* tipText) {
  const bool changed = ImGui::Checkbox(text, &value);
  tip(tipText);
  return changed;
}

void weakText(const std::string& text) {
  ImGui::PushStyleColor(ImGuiCol_Text, ImGui::GetStyleColorVec4(ImGuiCol_TextDisabled));
  ImGui::PushTextWrapPos(0.0f);
  ImGui::TextUnformatted(text.c_str());
  ImGui::PopTextWrapPos();
  ImGui::PopStyleColor();
}

void figure(const char* name, const std::string& value, const char* tipText) {
  ImGui::TextUnformatted(name);
  tip(tipText);
  ImGui::SameLine(0.44f * ImGui::GetWindowWidth());
  ImGui::TextUnformatted(value.c_str());
}

void heading(const char* text) {
  ImGui::Spacing();
  ImGui::TextColored(ImVec4(0.95f, 0.66f, 0.36f, 1.0f), "%s", text);
  ImGui::Separator();
}

}  // namespace trex
