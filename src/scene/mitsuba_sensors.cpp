#include <algorithm>
#include <glm/gtc/matrix_inverse.hpp>

#include "src/scene/mitsuba_lights.h"

namespace trex::detail::mitsuba {
namespace {

/// Pixels of a film.
struct Film {
  double width = 768.0, height = 576.0;
  double aspect() const { return width / height; }
};

Film readFilm(const Properties& sensor) {
  Film film;
  for (const Element* e : sensor.objects("film")) {
    const Properties of(sensor.context(), *e);
    film.width = of.number("width", film.width, 1.0, 65536.0);
    film.height = of.number("height", film.height, 1.0, 65536.0);
    if (of.has("crop_width") || of.has("crop_height")) {
      sensor.context().note(*e, "the whole film is shown, not its crop");
    }
  }
  return film;
}

/// Half the tangent of the vertical field of view, from one along the axis that is told.
double verticalTangent(const Properties& of, const Film& film) {
  std::string axis = of.text("fov_axis", "x");
  double degrees = of.number("fov", 50.0, 1e-4, 179.99);
  double tangent = std::tan(glm::radians(0.5 * degrees));
  if (of.has("focal_length")) {
    // Of a film of 36 by 24 mm, whose diagonal counts.
    std::string text = of.text("focal_length");
    text = text.substr(0, text.find("mm"));
    const std::vector<double> n = numbersOf(text);
    const double millimetres = n.size() == 1 && n[0] > 0.0 ? n[0] : 50.0;
    tangent = std::hypot(36.0, 24.0) / (2.0 * millimetres);
    axis = "diagonal";
  }
  if (axis == "smaller") axis = film.aspect() > 1.0 ? "y" : "x";
  if (axis == "larger") axis = film.aspect() > 1.0 ? "x" : "y";
  if (axis == "y") return tangent;
  if (axis == "diagonal") return tangent / std::hypot(1.0, film.aspect());
  if (axis != "x") {
    of.context().replace(of.element(), fmt::format("fov_axis '{:.40}' is taken for x", axis));
  }
  return tangent / film.aspect();
}

void readLens(const Properties& of, Camera& camera) {
  const double radius = of.number("aperture_radius", 0.0, 0.0, 1e6);
  camera.focus = static_cast<float>(of.number("focus_distance", 1.0, 1e-9, 1e12));
  if (!(radius > 0.0)) return;
  // What Camera::lensRadius() makes this radius of.
  camera.fstop = static_cast<float>(double(Camera::kSensorHeight) /
                                    (4.0 * std::tan(0.5 * double(camera.verticalFov)) * radius));
}

}  // namespace

void addSensor(Context& context, const Element& sensor) {
  const Properties of(context, sensor);
  const std::string_view type = sensor.type();
  const bool parallel = type == "orthographic" || type == "telecentric";
  if (type != "perspective" && type != "thinlens" && !parallel) {
    context.replace(sensor, fmt::format("sensor '{:.40}' is not known; it is left out", type));
    return;
  }
  const Film film = readFilm(of);
  const dmat4 m = of.transform("to_world");
  Camera camera;
  camera.name = sensor.attribute("id").empty()
                    ? fmt::format("sensor {}", context.scene().cameras.size() + 1)
                    : std::string(sensor.attribute("id"));
  camera.eye = dvec3(m[3]);
  if (!usable(m)) {
    context.replace(sensor, "a sensor with a transform that has no volume is left out");
    return;
  }
  const dvec3 forward = glm::normalize(dvec3(m[2]));
  const dvec3 up = dvec3(m[1]) - glm::dot(dvec3(m[1]), forward) * forward;
  camera.forward = vec3(forward);
  camera.up = vec3(glm::normalize(up));
  if (glm::determinant(glm::dmat3(m)) < 0.0) {
    context.replace(sensor, "a sensor that mirrors its picture is shown without");
  }
  if (parallel) {
    camera.orthographic = true;
    camera.orthographicHeight = static_cast<float>(2.0 * glm::length(dvec3(m[0])) / film.aspect());
  } else {
    camera.verticalFov = static_cast<float>(2.0 * std::atan(verticalTangent(of, film)));
  }
  if (type == "thinlens") readLens(of, camera);
  for (const char* offset : {"principal_point_offset_x", "principal_point_offset_y"}) {
    if (of.number(offset, 0.0) == 0.0) continue;
    context.replace(sensor, fmt::format("{} is not shown", offset));
  }
  of.ignore({"near_clip", "far_clip", "focus_distance", "shutter_open", "shutter_close"});
  for (const char* part : {"sampler", "medium"}) static_cast<void>(of.objects(part));
  of.tellUnused();
  context.note(sensor, fmt::format("the film is of --size {}x{}", film.width, film.height));
  context.scene().cameras.push_back(camera);
}

}  // namespace trex::detail::mitsuba
