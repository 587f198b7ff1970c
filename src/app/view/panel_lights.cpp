#include <fmt/format.h>

#include <cmath>

#include "src/app/view/panels.h"
#include "src/viewer/light_units.h"

namespace trex {
namespace {

void addButtons(Ui& ui) {
  ImGui::AlignTextToFramePadding();
  ImGui::TextUnformatted("Add");
  for (const Light::Type type :
       {Light::Type::kPoint, Light::Type::kSpot, Light::Type::kDirectional}) {
    ImGui::SameLine();
    if (!ImGui::Button(lightTypeName(type))) continue;
    Look look = ui.viewer.look();
    const double distance = glm::length(ui.camera->pivot() - look.camera.eye);
    look.lights.push_back(newLight(type, look, distance, ui.camera->sceneSize()));
    ui.editor.commit(look, fmt::format("Add {}", lightTypeName(type)));
    ui.selectLight(static_cast<int>(look.lights.size()) - 1);
  }
}

void listLights(Ui& ui) {
  const auto& lights = ui.viewer.look().lights;
  if (lights.empty()) weakText("No lamps or suns. Add one, or let a material shine.");
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const std::string name = fmt::format("{}  ({})##light{}", shownName(lights[i].name, "light", i),
                                         lightTypeName(lights[i].type), i);
    if (ImGui::Selectable(name.c_str(), ui.light == static_cast<int>(i))) {
      ui.light = static_cast<int>(i);
    }
  }
}

/// Azimuth and elevation of where a light shines from, degrees.
bool directionSliders(Light& light) {
  const vec3 from = -light.direction;
  float elevation = glm::degrees(std::asin(std::clamp(from.y, -1.0f, 1.0f)));
  float azimuth = glm::degrees(std::atan2(from.x, from.z));
  bool moved = slider("From", azimuth, -180.0f, 180.0f, "%.1f\xc2\xb0", false,
                      "Where it shines from: around the vertical, 0 along +z");
  moved |= slider("Height", elevation, -89.9f, 89.9f, "%.1f\xc2\xb0", false,
                  "Where it shines from: above the horizon");
  if (!moved) return false;
  const float e = glm::radians(elevation), a = glm::radians(azimuth);
  light.direction = -vec3(std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a));
  return true;
}

std::string powerWidgets(Light& light) {
  std::string what;
  vec3 color = lightColor(light);
  float power = lightPower(light);
  const bool sun = light.type == Light::Type::kDirectional;
  if (colorBox("Colour", &color.x)) {
    setLight(light, color, power);
    what = "Colour";
  }
  if (slider(sun ? "Irradiance" : "Power", power, 0.0f, sun ? 100.0f : 1e5f,
             sun ? "%.3g W/m\xc2\xb2" : "%.4g W", true,
             "Radiometric, of the strongest channel; Ctrl+click to type any value")) {
    setLight(light, color, power);
    what = sun ? "Irradiance" : "Power";
  }
  return what;
}

std::string coneWidgets(Light& light) {
  std::string what;
  const vec3 color = lightColor(light);
  const float power = lightPower(light);
  float outer = glm::degrees(light.outerConeAngle), inner = glm::degrees(light.innerConeAngle);
  if (slider("Cone", outer, 1.0f, 90.0f, "%.1f\xc2\xb0", false, "Half angle of the cone")) {
    what = "Cone";
  }
  inner = std::min(inner, outer);
  if (slider("Full within", inner, 0.0f, outer, "%.1f\xc2\xb0", false,
             "Half angle up to which it is at its brightest")) {
    what = "Inner cone";
  }
  if (what.empty()) return what;
  light.outerConeAngle = glm::radians(outer);
  light.innerConeAngle = glm::radians(std::min(inner, outer));
  setLight(light, color, power);
  return what;
}

void oneLight(Ui& ui) {
  const auto index = static_cast<std::size_t>(ui.light);
  Look look = ui.viewer.look();
  Light& light = look.lights[index];
  const std::string name = shownName(light.name, "light", index);
  heading(name.c_str());
  std::string what = powerWidgets(light);
  const bool sun = light.type == Light::Type::kDirectional;
  if (!sun && pointBox("Position, m", light.position, ui.camera->sceneSize())) what = "Move";
  if (light.type != Light::Type::kPoint && directionSliders(light)) what = "Turn";
  const auto most = static_cast<float>(0.25 * ui.camera->sceneSize());
  if (!sun && slider("Radius", light.radius, 0.0f, most, "%.3f m", true,
                     "Of the ball that shines; larger: softer shadows")) {
    what = "Radius";
  }
  if (light.type == Light::Type::kSpot) {
    if (const std::string cone = coneWidgets(light); !cone.empty()) what = cone;
  }
  if (!what.empty()) ui.editor.change(look, fmt::format("{} of {}", what, name));
  if (ImGui::Button("Duplicate")) {
    Light copy = ui.viewer.look().lights[index];
    copy.position += 0.03 * ui.camera->sceneSize() * dvec3(look.camera.up);
    look.lights.push_back(copy);
    ui.editor.commit(look, "Duplicate " + name);
    ui.light = static_cast<int>(look.lights.size()) - 1;
  }
  ImGui::SameLine();
  if (ImGui::Button("Remove")) {
    look.lights.erase(look.lights.begin() + static_cast<std::ptrdiff_t>(index));
    ui.editor.commit(look, "Remove " + name);
    ui.light = kNone;
  }
  if (!sun) weakText("Or drag its handles in the picture.");
}

void environmentWidgets(Ui& ui) {
  heading("Environment");
  Look look = ui.viewer.look();
  Environment& sky = look.environment;
  std::string what;
  vec3 color;
  float strength = 0.0f;
  splitEmission(sky.color, color, strength);
  bool changed = slider("Strength", strength, 0.0f, 100.0f, "%.3g", true,
                        sky.map ? "Factor of the map" : "Radiance, W/sr/m\xc2\xb2");
  if (strength > 0.0f) changed |= colorBox("Colour", &color.x);
  if (changed) {
    const float most = maxComponent(color);
    sky.color = strength * (most > 0.0f ? color / most : vec3(1.0f));
    what = "Environment";
  }
  if (sky.map) {
    float degrees = glm::degrees(sky.rotation);
    if (slider("Rotation", degrees, -180.0f, 180.0f, "%.1f\xc2\xb0")) {
      sky.rotation = glm::radians(degrees);
      what = "Rotation of the environment";
    }
  }
  if (!what.empty()) ui.editor.change(look, what);
}

void shiningMaterials(Ui& ui) {
  heading("Materials that shine");
  const auto& materials = ui.viewer.look().materials;
  bool any = false;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    if (!materials[i].emits()) continue;
    any = true;
    const std::string name =
        fmt::format("{}##shines{}", shownName(materials[i].name, "material", i), i);
    if (ImGui::Selectable(name.c_str())) ui.selectMaterial(static_cast<int>(i));
    tip("Opens this material");
  }
  if (!any) weakText("None.");
}

}  // namespace

void lightsPanel(Ui& ui) {
  addButtons(ui);
  listLights(ui);
  if (ui.light >= static_cast<int>(ui.viewer.look().lights.size())) ui.light = kNone;
  if (ui.light != kNone) oneLight(ui);
  environmentWidgets(ui);
  shiningMaterials(ui);
}

}  // namespace trex
