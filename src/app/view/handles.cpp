#include "src/app/view/handles.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "src/app/view/panels.h"

namespace trex {
namespace {

constexpr float kReach = 9.0f;  ///< window pixels from a handle that still hold it
constexpr float kArm = 70.0f;   ///< window pixels of an axis
constexpr ImU32 kAxisColors[] = {IM_COL32(230, 80, 80, 255), IM_COL32(110, 200, 80, 255),
                                 IM_COL32(90, 140, 240, 255)};
constexpr ImU32 kMark = IM_COL32(255, 220, 120, 255), kShadow = IM_COL32(0, 0, 0, 160);

enum class Held { kNothing, kAxis, kCentre, kDivider };
Held held = Held::kNothing;
int heldAxis = 0;

dvec3 axisOf(int axis) {
  dvec3 v(0.0);
  v[axis] = 1.0;
  return v;
}

bool lightsShown(const Ui& ui) { return !ui.hidden && ui.panel == Panel::kLights && ui.shows(); }

bool placed(const Light& light) { return light.type != Light::Type::kDirectional; }

const Light* selectedLight(const Ui& ui) {
  const auto& lights = ui.viewer.look().lights;
  if (ui.light < 0 || ui.light >= static_cast<int>(lights.size())) return nullptr;
  const Light& light = lights[static_cast<std::size_t>(ui.light)];
  return placed(light) ? &light : nullptr;
}

/// Metres that a pixel of the window covers at a point.
double metresAPixel(const Ui& ui, const dvec3& at) {
  const Camera& c = ui.viewer.look().camera;
  const double depth = glm::dot(at - c.eye, dvec3(c.forward));
  const double height = c.orthographic ? double(c.orthographicHeight)
                                       : 2.0 * depth * std::tan(0.5 * double(c.verticalFov));
  return height / double(ui.window.height());
}

float segmentDistance(const vec2& p, const vec2& a, const vec2& b) {
  const vec2 along = b - a;
  const float length = glm::dot(along, along);
  const float t = length > 0.0f ? glm::clamp(glm::dot(p - a, along) / length, 0.0f, 1.0f) : 0.0f;
  return glm::length(p - a - t * along);
}

/// Ends of an axis in pixels of the picture; false if it is not in view.
bool axisEnds(const Ui& ui, const Light& light, int axis, vec2& from, vec2& to) {
  const dvec3 tip = light.position + kArm * metresAPixel(ui, light.position) * axisOf(axis);
  return ui.viewer.project(light.position, from) && ui.viewer.project(tip, to);
}

ImVec2 onScreen(const Ui& ui, const vec2& pixel) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  const vec2 p = pixel * ui.pictureScale();
  return ImVec2(p.x / scale.x, p.y / scale.y);
}

void drawAxes(Ui& ui, const Light& light) {
  ImDrawList& draw = *ImGui::GetBackgroundDrawList();
  for (int axis = 0; axis < 3; ++axis) {
    vec2 from, to;
    if (!axisEnds(ui, light, axis, from, to)) continue;
    const ImVec2 a = onScreen(ui, from), b = onScreen(ui, to);
    const float wide = held == Held::kAxis && heldAxis == axis ? 4.0f : 2.5f;
    draw.AddLine(a, b, kShadow, wide + 2.0f);
    draw.AddLine(a, b, kAxisColors[axis], wide);
    draw.AddCircleFilled(b, 5.0f, kAxisColors[axis], 12);
  }
}

void moveSelected(Ui& ui, const dvec3& by) {
  Look look = ui.viewer.look();
  look.lights[static_cast<std::size_t>(ui.light)].position += by;
  ui.editor.change(look, "Move light");
}

void dragAxis(Ui& ui, const Light& light, const vec2& moved) {
  vec2 from, to;
  if (!axisEnds(ui, light, heldAxis, from, to)) return;
  const vec2 along = to - from;
  const double length = double(glm::dot(along, along));
  if (length < 1.0) return;  // looked at along the axis
  const double arm = kArm * metresAPixel(ui, light.position);
  moveSelected(ui, arm * double(glm::dot(moved, along)) / length * axisOf(heldAxis));
}

void dragCentre(Ui& ui, const Light& light, const vec2& moved) {
  const Camera& c = ui.viewer.look().camera;
  const vec2 window = moved * ui.pictureScale();
  const dvec3 right(glm::cross(c.forward, c.up));
  moveSelected(ui, metresAPixel(ui, light.position) *
                       (double(window.x) * right - double(window.y) * dvec3(c.up)));
}

float dividerColumn(const Ui& ui) {
  return ui.viewer.state().splitAt * static_cast<float>(ui.viewer.screen().width);
}

}  // namespace

void drawHandles(Ui& ui) {
  if (!lightsShown(ui)) return;
  ImDrawList& draw = *ImGui::GetBackgroundDrawList();
  const auto& lights = ui.viewer.look().lights;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    vec2 at;
    if (!placed(lights[i]) || !ui.viewer.project(lights[i].position, at)) continue;
    const ImVec2 p = onScreen(ui, at);
    draw.AddCircleFilled(p, 7.0f, kShadow, 16);
    if (static_cast<int>(i) == ui.light) {
      draw.AddCircleFilled(p, 5.5f, kMark, 16);
    } else {
      draw.AddCircle(p, 5.0f, kMark, 16, 2.0f);
    }
  }
  if (const Light* light = selectedLight(ui)) drawAxes(ui, *light);
}

void drawDivider(Ui& ui) {
  if (!ui.viewer.state().split || !ui.shows()) return;
  ImDrawList& draw = *ImGui::GetBackgroundDrawList();
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const float x = onScreen(ui, vec2(dividerColumn(ui), 0.0f)).x;
  draw.AddLine(ImVec2(x, 0.0f), ImVec2(x, screen.y), kShadow, 3.0f);
  draw.AddLine(ImVec2(x, 0.0f), ImVec2(x, screen.y), kMark, 1.0f);
  draw.AddCircleFilled(ImVec2(x, 0.5f * screen.y), 7.0f, kMark, 16);
  const float y = screen.y - 44.0f;
  const char* left = "guess";
  draw.AddText(ImVec2(x - ImGui::CalcTextSize(left).x - 8.0f, y), kMark, left);
  draw.AddText(ImVec2(x + 8.0f, y), kMark, "exact");
}

int lightAt(Ui& ui, const vec2& pixel) {
  if (!lightsShown(ui)) return kNone;
  const auto& lights = ui.viewer.look().lights;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    vec2 at;
    if (!placed(lights[i]) || !ui.viewer.project(lights[i].position, at)) continue;
    if (glm::length((at - pixel) * ui.pictureScale()) < kReach) return static_cast<int>(i);
  }
  return kNone;
}

bool holdHandle(Ui& ui, const vec2& pixel) {
  held = Held::kNothing;
  if (!ui.shows()) return false;
  const vec2 scale = ui.pictureScale();
  if (ui.viewer.state().split && std::abs(pixel.x - dividerColumn(ui)) * scale.x < kReach) {
    held = Held::kDivider;
    return true;
  }
  const Light* light = lightsShown(ui) ? selectedLight(ui) : nullptr;
  if (light == nullptr) return false;
  vec2 from, to;
  if (ui.viewer.project(light->position, from) && glm::length((pixel - from) * scale) < kReach) {
    held = Held::kCentre;
    return true;
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (!axisEnds(ui, *light, axis, from, to)) continue;
    if (segmentDistance(pixel * scale, from * scale, to * scale) >= kReach) continue;
    held = Held::kAxis;
    heldAxis = axis;
    return true;
  }
  return false;
}

void dragHandle(Ui& ui, const vec2& from, const vec2& to) {
  if (held == Held::kDivider) {
    const auto width = static_cast<float>(std::max(ui.viewer.screen().width, 1u));
    ui.viewer.state().splitAt = glm::clamp(to.x / width, 0.0f, 1.0f);
    return;
  }
  const Light* light = selectedLight(ui);
  if (light == nullptr) return;
  if (held == Held::kAxis) dragAxis(ui, *light, to - from);
  if (held == Held::kCentre) dragCentre(ui, *light, to - from);
}

void releaseHandle() { held = Held::kNothing; }
bool handleHeld() { return held != Held::kNothing; }

}  // namespace trex
