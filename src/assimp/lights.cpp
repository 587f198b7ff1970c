#include "src/assimp/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "src/core/maths.h"

namespace trex {
namespace {

using Json = GltfWriter::Json;

/// A matrix that takes -z, along which glTF looks, to a direction, and y near to `up`.
Json lookingAlong(const aiVector3D& eye, const aiVector3D& direction, const aiVector3D& up) {
  vec3 back(-direction.x, -direction.y, -direction.z);
  back = glm::length(back) > 0.0f && isFinite(back) ? glm::normalize(back) : vec3(0.0f, 0.0f, 1.0f);
  vec3 right = glm::cross(vec3(up.x, up.y, up.z), back);
  right = glm::length(right) > 1e-6f ? glm::normalize(right) : Basis(back).tangent;
  const vec3 above = glm::cross(back, right);
  return {right.x, right.y, right.z, 0, above.x, above.y, above.z, 0,
          back.x,  back.y,  back.z,  0, eye.x,   eye.y,   eye.z,   1};
}

/// Brightness at a distance of 1 m. In the formats that assimp reads, a lamp of colour 1 makes a
/// white surface that faces it white: irradiance pi. One whose falloff is not that of light does so
/// as far away as the scene is large.
double intensityOf(const aiLight& light, double unit, double radius, GltfWriter& out) {
  if (light.mType == aiLightSource_DIRECTIONAL) return std::numbers::pi;
  if (light.mAttenuationQuadratic > 0.0f) {
    return std::numbers::pi * unit * unit / light.mAttenuationQuadratic;
  }
  out.replaced(
      fmt::format("light '{}': its falloff is not that of light; it is as bright as the file says "
                  "at {:.3g} m",
                  light.mName.C_Str(), radius));
  return std::numbers::pi * radius * radius;
}

}  // namespace

LightWriter::LightWriter(const aiScene& scene, double unit, double radius, GltfWriter& out)
    : out_(out) {
  for (unsigned i = 0; i < scene.mNumLights; ++i) addLight(*scene.mLights[i], unit, radius);
  for (unsigned i = 0; i < scene.mNumCameras; ++i) addCamera(*scene.mCameras[i]);
}

std::vector<int> LightWriter::nodesOf(const std::string& name) const {
  std::vector<int> out;
  const auto [first, end] = nodes_.equal_range(name);
  for (auto it = first; it != end; ++it) out.push_back(it->second);
  return out;
}

void LightWriter::addLight(const aiLight& light, double unit, double radius) {
  const std::string name = light.mName.C_Str();
  const char* type = light.mType == aiLightSource_DIRECTIONAL ? "directional"
                     : light.mType == aiLightSource_SPOT      ? "spot"
                     : light.mType == aiLightSource_POINT     ? "point"
                                                              : nullptr;
  if (type == nullptr) {
    out_.replaced(fmt::format("light '{}': is of a kind that is not shown; it is left out", name));
    return;
  }
  const aiColor3D& c = light.mColorDiffuse;
  const double strongest = std::max({c.r, c.g, c.b});
  if (!(strongest > 0.0) || !std::isfinite(strongest)) return;
  Json to = {{"name", name},
             {"type", type},
             {"color", {c.r / strongest, c.g / strongest, c.b / strongest}},
             {"intensity", strongest * intensityOf(light, unit, radius, out_)}};
  if (light.mType == aiLightSource_SPOT) {
    const double outer = std::clamp(0.5 * light.mAngleOuterCone, 1e-3, 0.5 * std::numbers::pi);
    to["spot"] = {{"outerConeAngle", outer},
                  {"innerConeAngle", std::clamp(0.5 * light.mAngleInnerCone, 0.0, outer)}};
  }
  out_.useExtension("KHR_lights_punctual");
  Json& lights = out_.root()["extensions"]["KHR_lights_punctual"]["lights"];
  lights.push_back(std::move(to));
  nodes_.emplace(
      name, out_.add("nodes",
                     {{"name", name},
                      {"matrix", lookingAlong(light.mPosition, light.mDirection, light.mUp)},
                      {"extensions", {{"KHR_lights_punctual", {{"light", lights.size() - 1}}}}}}));
}

void LightWriter::addCamera(const aiCamera& camera) {
  constexpr double kAspect = 16.0 / 9.0;
  const std::string name = camera.mName.C_Str();
  const double aspect = camera.mAspect > 0.0f ? camera.mAspect : kAspect;
  Json to = {{"name", name}};
  if (camera.mOrthographicWidth > 0.0f) {
    const double half = camera.mOrthographicWidth;
    to["type"] = "orthographic";
    to["orthographic"] = {{"xmag", half}, {"ymag", half / aspect}, {"znear", 0}, {"zfar", 1}};
  } else {
    const double fov = 2.0 * std::atan(std::tan(0.5 * camera.mHorizontalFOV) / aspect);
    to["type"] = "perspective";
    to["perspective"] = {{"yfov", fov}, {"znear", 0.1}};
  }
  const int number = out_.add("cameras", std::move(to));
  nodes_.emplace(
      name,
      out_.add("nodes", {{"name", name},
                         {"camera", number},
                         {"matrix", lookingAlong(camera.mPosition, camera.mLookAt, camera.mUp)}}));
}

}  // namespace trex
