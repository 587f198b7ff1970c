// Applying a step of a script to camera and look.
#include <algorithm>

#include "src/core/error.h"
#include "src/core/json_object.h"
#include "src/scene/import.h"
#include "src/scene/scene_json.h"
#include "src/viewer/replay.h"
#include "src/viewer/visibility.h"

namespace trex {
namespace {

vec2 pair(const JsonObject& o, const char* key) {
  double v[2];
  o.numbers(key, v, 2);
  return vec2(static_cast<float>(v[0]), static_cast<float>(v[1]));
}

void moveCamera(const nlohmann::json& json, const JsonDocument& document, const ReplayScene& scene,
                CameraControl& camera) {
  const JsonObject o(json, document, "/camera");
  o.allow({"orbit", "look", "pan", "dolly", "fly", "seconds", "frame", "fov", "pivot"});
  if (o.has("pivot")) {
    dvec3 pivot;
    o.numbers("pivot", &pivot.x, 3);
    camera.setPivot(pivot);
  }
  if (o.has("orbit")) camera.orbit(pair(o, "orbit"));
  if (o.has("look")) camera.look(pair(o, "look"));
  if (o.has("pan")) camera.pan(pair(o, "pan"));
  if (o.has("dolly")) camera.dolly(o.real("dolly", -1000.0f, 1000.0f));
  if (o.has("fov")) camera.setFieldOfView(glm::radians(o.real("fov", 1.0f, 179.0f)));
  if (o.has("fly")) {
    const vec3 direction = jsonVector(o, "fly", -1.0f, 1.0f);
    camera.fly(direction, o.has("seconds") ? o.number("seconds", 0.0, 1e4) : 1.0, 1.0);
  }
  if (o.has("frame") && o.boolean("frame")) camera.frame(scene.bounds, scene.aspect);
}

/// The number that a name, or a number, stands for.
template <typename Names>
std::uint32_t resolve(const nlohmann::json& which, const char* kind, std::size_t count,
                      const Names& nameOf) {
  if (which.is_number_unsigned() && which.get<std::uint64_t>() < count) {
    return which.get<std::uint32_t>();
  }
  if (which.is_string()) {
    for (std::size_t i = 0; i < count; ++i) {
      if (nameOf(i) == which.get<std::string>()) return static_cast<std::uint32_t>(i);
    }
  }
  fail(ExitCode::kInput, "replay: there is no {} {}; the scene has {} of them", kind,
       which.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), count);
}

/// Takes "index" or "name" out of an object and finds what it means.
template <typename Names>
std::uint32_t takeWhich(nlohmann::json& values, const char* kind, std::size_t count,
                        const Names& nameOf) {
  for (const char* key : {"index", "name"}) {
    if (!values.contains(key)) continue;
    const nlohmann::json which = values.at(key);
    values.erase(key);
    return resolve(which, kind, count, nameOf);
  }
  fail(ExitCode::kInput, "replay: which {}? give its name or index", kind);
}

void editMaterial(nlohmann::json values, const JsonDocument& document, Look& look) {
  const auto nameOf = [&](std::size_t i) { return look.materials[i].name; };
  const std::uint32_t index = takeWhich(values, "material", look.materials.size(), nameOf);
  const JsonObject o(values, document, "/material");
  o.allow(std::span(materialKeys()));
  readMaterialJson(o, look.materials[index], false);
}

/// The light with some of its values replaced.
Light changedLight(const Light& light, const nlohmann::json& values, const JsonDocument& document) {
  nlohmann::json all = nlohmann::json::parse(lightJson(light).dump());
  all.update(values);
  return readLightJson(JsonObject(all, document, "/light"));
}

void editLight(nlohmann::json values, const JsonDocument& document, Look& look) {
  if (values.contains("add") && values.at("add") == true) {
    values.erase("add");
    look.lights.push_back(changedLight(Light{}, values, document));
    return;
  }
  const bool remove = values.contains("remove") && values.at("remove") == true;
  values.erase("remove");
  const auto nameOf = [&](std::size_t i) { return look.lights[i].name; };
  const std::uint32_t index = takeWhich(values, "light", look.lights.size(), nameOf);
  if (remove) {
    look.lights.erase(look.lights.begin() + index);
  } else {
    look.lights[index] = changedLight(look.lights[index], values, document);
  }
}

void editEnvironment(const nlohmann::json& values, const JsonDocument& document, Look& look) {
  const JsonObject o(values, document, "/environment");
  o.allow({"color", "rotation_radians"});
  if (o.has("color")) look.environment.color = jsonVector(o, "color", 0.0f);
  if (o.has("rotation_radians")) {
    look.environment.rotation = o.real("rotation_radians", -1e4f, 1e4f);
  }
}

void editSection(const nlohmann::json& values, const JsonDocument& document, Look& look) {
  const JsonObject o(values, document, "/section");
  o.allow({"point", "normal"});
  SectionPlane plane;
  o.numbers("point", &plane.point.x, 3);
  plane.normal = jsonUnitVector(o, "normal");
  look.section = plane;
}

void editVisibility(const ReplayStep& step, const Scene& scene, Look& look) {
  const auto count = static_cast<std::uint32_t>(scene.objects.size());
  const auto nameOf = [&](std::size_t i) { return scene.objects[i]; };
  const auto object = [&](const nlohmann::json& which) {
    return resolve(which, "object", count, nameOf);
  };
  if (step.showAll) look.hidden.clear();
  if (!step.isolate.is_null()) isolate(look, object(step.isolate), count);
  if (!step.hide.is_null()) {
    for (const nlohmann::json& which : step.hide) setHidden(look, object(which), true);
  }
  if (!step.show.is_null()) {
    for (const nlohmann::json& which : step.show) setHidden(look, object(which), false);
  }
}

}  // namespace

void applyReplay(const ReplayStep& step, const ReplayScene& scene, CameraControl& camera,
                 Look& look) {
  const JsonDocument document{"replay, step '" + step.label + "'", ""};
  if (!step.camera.empty()) camera.setCamera(parseCamera(step.camera, scene.scene));
  if (!step.cameraMove.is_null()) moveCamera(step.cameraMove, document, scene, camera);
  look.camera = camera.camera();
  if (step.revert) {
    const Look now = look;
    look = scene.source;
    look.camera = now.camera;
    look.exposure = now.exposure;
  }
  if (step.exposure) look.exposure = *step.exposure;
  if (!step.material.is_null()) editMaterial(step.material, document, look);
  if (!step.light.is_null()) editLight(step.light, document, look);
  if (!step.environment.is_null()) editEnvironment(step.environment, document, look);
  if (!step.section.is_null()) editSection(step.section, document, look);
  if (step.noSection) look.section.reset();
  editVisibility(step, scene.scene, look);
}

}  // namespace trex
