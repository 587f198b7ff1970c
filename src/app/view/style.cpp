#include "src/app/view/style.h"

#include <imgui.h>

#include <cmath>
#include <filesystem>
#include <initializer_list>

namespace trex {
namespace {

void loadFont(float scale) {
  ImGuiIO& io = ImGui::GetIO();
  io.Fonts->Clear();
  for (const char* path : {"/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf",
                           "/usr/share/fonts/dejavu-sans-fonts/DejaVuSans.ttf",
                           "/usr/share/fonts/TTF/DejaVuSans.ttf"}) {
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored)) continue;
    // Latin, punctuation such as dashes, superscripts and arrows.
    static const ImWchar ranges[] = {0x20,   0x17f,  0x2010, 0x2044, 0x2070,
                                     0x209f, 0x2190, 0x21ff, 0};
    if (io.Fonts->AddFontFromFileTTF(path, std::round(13.0f * scale), nullptr, ranges)) return;
  }
  ImFontConfig config;
  config.SizePixels = std::round(13.0f * scale);
  io.Fonts->AddFontDefault(&config);
}

ImVec4 grey(float value, float alpha = 1.0f) { return ImVec4(value, value, value * 1.04f, alpha); }

}  // namespace

void applyStyle(float scale) {
  loadFont(scale);
  ImGui::StyleColorsDark();
  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowRounding = 0.0f;
  style.FrameRounding = 3.0f;
  style.PopupRounding = 3.0f;
  style.GrabRounding = 3.0f;
  style.WindowBorderSize = 0.0f;
  style.WindowPadding = ImVec2(8.0f, 6.0f);
  style.FramePadding = ImVec2(6.0f, 3.0f);
  style.ItemSpacing = ImVec2(6.0f, 4.0f);
  style.ScrollbarSize = 11.0f;
  style.ScaleAllSizes(scale);
  // A software device draws each of these line by line.
  style.AntiAliasedLinesUseTex = true;
  const ImVec4 accent(0.85f, 0.50f, 0.16f, 1.0f);
  const auto tinted = [&](float alpha) { return ImVec4(accent.x, accent.y, accent.z, alpha); };
  ImVec4* c = style.Colors;
  c[ImGuiCol_Text] = grey(0.90f);
  c[ImGuiCol_TextDisabled] = grey(0.55f);
  c[ImGuiCol_WindowBg] = grey(0.11f, 0.94f);
  c[ImGuiCol_PopupBg] = grey(0.13f, 0.98f);
  c[ImGuiCol_MenuBarBg] = grey(0.13f);
  c[ImGuiCol_TitleBg] = c[ImGuiCol_TitleBgActive] = grey(0.18f);
  c[ImGuiCol_FrameBg] = grey(0.20f);
  c[ImGuiCol_FrameBgHovered] = grey(0.26f);
  c[ImGuiCol_FrameBgActive] = grey(0.30f);
  c[ImGuiCol_Button] = grey(0.24f);
  c[ImGuiCol_ButtonHovered] = grey(0.32f);
  c[ImGuiCol_ButtonActive] = tinted(0.80f);
  c[ImGuiCol_Header] = tinted(0.45f);
  c[ImGuiCol_HeaderHovered] = tinted(0.30f);
  c[ImGuiCol_HeaderActive] = tinted(0.60f);
  c[ImGuiCol_CheckMark] = accent;
  c[ImGuiCol_SliderGrab] = tinted(0.85f);
  c[ImGuiCol_SliderGrabActive] = accent;
  c[ImGuiCol_PlotHistogram] = tinted(0.75f);
  c[ImGuiCol_TextSelectedBg] = tinted(0.40f);
  c[ImGuiCol_NavHighlight] = accent;
}

}  // namespace trex
