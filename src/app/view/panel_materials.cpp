#include <fmt/format.h>

#include <cmath>

#include "src/app/view/panels.h"
#include "src/viewer/light_units.h"

namespace trex {
namespace {

void listMaterials(Ui& ui) {
  searchBox("Search materials", ui.materialSearch);
  const auto& materials = ui.viewer.look().materials;
  const auto& source = ui.viewer.sourceLook().materials;
  const float rows = std::min(7.0f, static_cast<float>(materials.size()) + 0.5f);
  const float height = std::min(rows * ImGui::GetTextLineHeightWithSpacing() + 8.0f,
                                0.34f * ImGui::GetWindowHeight());
  ImGui::BeginChild("materials", ImVec2(0.0f, height), true);
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const std::string name = shownName(materials[i].name, "material", i);
    if (!matches(name, ui.materialSearch)) continue;
    const bool selected = ui.material == static_cast<int>(i);
    const vec4& c = materials[i].baseColor;
    ImGui::PushID(static_cast<int>(i));
    const float side = ImGui::GetTextLineHeight();
    ImGui::ColorButton("##swatch", ImVec4(c.x, c.y, c.z, 1.0f), ImGuiColorEditFlags_NoTooltip,
                       ImVec2(side, side));
    ImGui::SameLine();
    const std::string shown = name + (materials[i] == source[i] ? "" : " *");
    if (ImGui::Selectable(shown.c_str(), selected)) ui.material = static_cast<int>(i);
    if (selected && ui.scrollToSelection) ImGui::SetScrollHereY();
    ImGui::PopID();
  }
  ImGui::EndChild();
}

/// What of a material was changed, or an empty text.
using What = std::string;

What surfaceWidgets(Material& m) {
  What what;
  if (colorBox("Base colour", &m.baseColor.x,
               m.baseColorTexture.present() ? "Multiplies the texture" : nullptr)) {
    what = "Base colour";
  }
  if (checkBox("Unlit", m.unlit, "Shows its base colour whatever the light")) what = "Unlit";
  ImGui::SameLine(0.5f * ImGui::GetWindowWidth());
  if (checkBox("Double-sided", m.doubleSided, "Shines from both sides")) what = "Double-sided";
  if (m.unlit) return what;
  if (slider("Metallic", m.metallic, 0.0f, 1.0f)) what = "Metallic";
  if (slider("Roughness", m.roughness, 0.0f, 1.0f)) what = "Roughness";
  if (m.metallic < 1.0f || m.metallicRoughnessTexture.present()) {
    if (slider("Specular", m.specular, 0.0f, 1.0f, "%.3f", false, "0: no gloss at all")) {
      what = "Specular";
    }
    if (m.specular > 0.0f && colorBox("Gloss colour", &m.specularColor.x)) what = "Gloss colour";
    if (slider("Index", m.ior, 1.0f, 3.0f, "%.3f", false, "Index of refraction")) what = "Index";
  }
  if (slider("Clear coat", m.finish.clearcoat, 0.0f, 1.0f)) what = "Clear coat";
  if (m.finish.coats() && slider("Coat roughness", m.finish.clearcoatRoughness, 0.0f, 1.0f)) {
    what = "Coat roughness";
  }
  if (m.normalTexture.present() && slider("Normal map", m.normalScale, 0.0f, 2.0f)) {
    what = "Normal map";
  }
  return what;
}

What emissionWidgets(Material& m) {
  heading("Emission");
  What what;
  vec3 color;
  float strength = 0.0f;
  splitEmission(m.emission, color, strength);
  const bool colored = strength > 0.0f && colorBox("Colour", &color.x);
  const bool strengthened =
      slider("Strength", strength, 0.0f, 1000.0f, "%.3g", true, "Radiance, W/sr/m\xc2\xb2");
  if (!colored && !strengthened) return what;
  const float most = maxComponent(color);
  m.emission = strength * (most > 0.0f ? color / most : vec3(1.0f));
  return "Emission";
}

What transmissionWidgets(Material& m) {
  heading("Transparency");
  What what;
  static const char* const kModes[] = {"opaque", "mask", "blend"};
  int mode = static_cast<int>(m.alphaMode);
  label("Alpha");
  if (ImGui::Combo("##alpha", &mode, kModes, 3)) {
    m.alphaMode = static_cast<AlphaMode>(mode);
    what = "Alpha mode";
  }
  if (m.alphaMode != AlphaMode::kOpaque && slider("Opacity", m.baseColor.w, 0.0f, 1.0f)) {
    what = "Opacity";
  }
  if (m.alphaMode == AlphaMode::kMask && slider("Cutoff", m.alphaCutoff, 0.0f, 1.0f)) {
    what = "Alpha cutoff";
  }
  if (m.unlit) return what;
  if (slider("Transmission", m.transmission, 0.0f, 1.0f, "%.3f", false, "1: glass")) {
    what = "Transmission";
  }
  if (!(m.transmission > 0.0f)) return what;
  if (checkBox("Solid", m.volume, "Refracts and absorbs; else a thin sheet")) what = "Solid";
  if (!m.volume) return what;
  bool absorbs = std::isfinite(m.attenuationDistance);
  if (checkBox("Absorbs", absorbs)) {
    m.attenuationDistance = absorbs ? 1.0f : kInfinity;
    what = "Absorption";
  }
  if (!absorbs) return what;
  if (colorBox("Tint", &m.attenuationColor.x, "Colour of light after the distance")) what = "Tint";
  if (slider("Distance", m.attenuationDistance, 0.001f, 100.0f, "%.3f m", true)) {
    what = "Absorption distance";
  }
  return what;
}

void revertButtons(Ui& ui, std::size_t index) {
  const Look& source = ui.viewer.sourceLook();
  const Look& now = ui.viewer.look();
  ImGui::BeginDisabled(now.materials[index] == source.materials[index]);
  if (ImGui::Button("Revert this")) {
    Look look = now;
    look.materials[index] = source.materials[index];
    ui.editor.commit(look, "Revert material");
  }
  tip("As the file has it");
  ImGui::EndDisabled();
  ImGui::SameLine();
  ImGui::BeginDisabled(now.materials == source.materials);
  if (ImGui::Button("Revert all")) {
    Look look = now;
    look.materials = source.materials;
    ui.editor.commit(look, "Revert all materials");
  }
  tip("All materials as the file has them");
  ImGui::EndDisabled();
}

}  // namespace

void materialsPanel(Ui& ui) {
  listMaterials(ui);
  const auto index = static_cast<std::size_t>(ui.material);
  if (index >= ui.viewer.look().materials.size()) return;
  Look look = ui.viewer.look();
  Material& m = look.materials[index];
  const std::string name = shownName(m.name, "material", index);
  ImGui::PushID(static_cast<int>(index));
  heading(name.c_str());
  std::string what = surfaceWidgets(m);
  if (const What emission = emissionWidgets(m); !emission.empty()) what = emission;
  if (const What clear = transmissionWidgets(m); !clear.empty()) what = clear;
  if (!what.empty()) ui.editor.change(look, fmt::format("{} of {}", what, name));
  ImGui::Spacing();
  revertButtons(ui, index);
  ImGui::PopID();
}

}  // namespace trex
