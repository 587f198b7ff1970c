// Cameras from the command line and from a box.
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

#include "src/core/error.h"
#include "src/scene/import.h"
#include "src/scene/input_file.h"

namespace trex {
namespace {

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (;;) {
    const std::size_t at = text.find(separator);
    parts.push_back(text.substr(0, at));
    if (at == std::string_view::npos) return parts;
    text.remove_prefix(at + 1);
  }
}

std::optional<double> parseNumber(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return {};
  return value;
}

std::optional<dvec3> parseTriple(std::string_view text) {
  const auto parts = split(text, ',');
  if (parts.size() != 3) return {};
  dvec3 triple;
  for (int i = 0; i < 3; ++i) {
    const auto value = parseNumber(parts[i]);
    if (!value) return {};
    triple[i] = *value;
  }
  return triple;
}

std::string cameraNames(const Scene& scene) {
  std::string names;
  for (std::size_t i = 0; i < scene.cameras.size() && i < 20; ++i) {
    names += (i == 0 ? "" : ", ") + scene.cameras[i].name;
  }
  return names.empty() ? "none" : names;
}

std::string tripleText(const dvec3& v) { return fmt::format("{},{},{}", v.x, v.y, v.z); }

Camera lookAt(const dvec3& eye, const dvec3& target, const dvec3& up) {
  Camera camera;
  camera.eye = eye;
  const dvec3 forward = glm::normalize(target - eye);
  const dvec3 right = glm::normalize(glm::cross(forward, glm::normalize(up)));
  camera.forward = vec3(forward);
  camera.up = vec3(glm::cross(right, forward));
  return camera;
}

/// The scene's camera of that name, or one at EYE/TARGET/UP/VFOV.
Camera parsePinhole(const std::string& text, const Scene& scene) {
  for (const Camera& camera : scene.cameras) {
    if (camera.name == text) return camera;
  }
  const auto parts = split(text, '/');
  if (parts.size() != 4) {
    fail(
        ExitCode::kUsage,
        "camera '{}': no such camera in the scene (it has: {}), and not EYE/TARGET/UP/VFOV such as "
        "0,1,5/0,1,0/0,1,0/40",
        text, cameraNames(scene));
  }
  const auto eye = parseTriple(parts[0]), target = parseTriple(parts[1]),
             up = parseTriple(parts[2]);
  const auto fov = parseNumber(parts[3]);
  if (!eye || !target || !up || !fov) {
    fail(ExitCode::kUsage, "camera '{}': EYE, TARGET and UP are x,y,z in metres, VFOV degrees",
         text);
  }
  if (!(*fov > 0.0 && *fov < 180.0)) {
    fail(ExitCode::kUsage, "camera '{}': the field of view must be between 0 and 180 degrees",
         text);
  }
  const dvec3 toTarget = *target - *eye;
  const double distance = glm::length(toTarget), upLength = glm::length(*up);
  if (!(distance > 0.0) || !(upLength > 0.0) ||
      !(glm::length(glm::cross(toTarget / distance, *up / upLength)) > 1e-9)) {
    fail(ExitCode::kUsage,
         "camera '{}': EYE and TARGET must differ and UP not point along the view", text);
  }
  Camera camera = lookAt(*eye, *target, *up);
  camera.name = text;
  camera.verticalFov = glm::radians(static_cast<float>(*fov));
  return camera;
}

void readLens(const std::string& text, const std::string& options, Camera& camera) {
  const auto set = [&](const std::string& key, std::span<const double> numbers) -> std::string {
    const double value = numbers.size() == 1 ? numbers[0] : std::nan("");
    if (key == "fstop") {
      if (!(value >= 1e-3 && value <= 1e6)) return "fstop must be a number in [0.001, 1e6]";
      camera.fstop = static_cast<float>(value);
    } else if (key == "focus") {
      if (!(value >= 1e-6 && value <= 1e18)) return "focus must be metres in [1e-6, 1e18]";
      camera.focus = static_cast<float>(value);
    } else {
      return "unknown option '" + key + "'; there are fstop and focus";
    }
    return {};
  };
  std::string problem = detail::parseOptions(options, set);
  if (problem.empty() && camera.orthographic) problem = "an orthographic camera has no lens";
  if (problem.empty() && !(camera.fstop > 0.0f && camera.focus > 0.0f)) {
    problem = "a lens needs fstop and focus";
  }
  if (!problem.empty()) {
    fail(ExitCode::kUsage, "camera '{}': {}; want CAMERA?fstop=N&focus=METRES", text, problem);
  }
}

}  // namespace

Camera parseCamera(const std::string& text, const Scene& scene) {
  for (const Camera& camera : scene.cameras) {
    if (camera.name == text) return camera;
  }
  const std::size_t question = text.rfind('?');
  Camera camera = parsePinhole(text.substr(0, question), scene);
  if (question != std::string::npos) readLens(text, text.substr(question + 1), camera);
  return camera;
}

std::string cameraText(const Camera& camera) {
  if (camera.orthographic) return camera.name;
  const dvec3 target = camera.eye + dvec3(camera.forward);
  const std::string text =
      fmt::format("{}/{}/{}/{}", tripleText(camera.eye), tripleText(target),
                  tripleText(dvec3(camera.up)), glm::degrees(camera.verticalFov));
  return camera.fstop > 0.0f ? fmt::format("{}?fstop={}&focus={}", text, camera.fstop, camera.focus)
                             : text;
}

Camera framingCamera(const Box3d& bounds) {
  const bool empty = bounds.empty();
  const dvec3 centre = empty ? dvec3(0.0) : bounds.centre();
  double radius = empty ? 1.0 : 0.5 * glm::length(bounds.size());
  if (!(radius > 0.0)) radius = 1.0;
  Camera camera;
  const double distance = 1.05 * radius / std::sin(0.5 * camera.verticalFov);
  const dvec3 towardsEye = glm::normalize(dvec3(0.0, 0.3, 1.0));
  const float fov = camera.verticalFov;
  // Far from the origin, the eye may round to the centre itself.
  camera = lookAt(towardsEye, dvec3(0.0), dvec3(0.0, 1.0, 0.0));
  camera.eye = centre + distance * towardsEye;
  camera.verticalFov = fov;
  camera.name = "framing";
  camera.framing = true;
  return camera;
}

Camera framedFor(Camera camera, std::uint32_t width, std::uint32_t height) {
  if (!camera.framing || width >= height || camera.orthographic) return camera;
  const double taller = static_cast<double>(height) / width;
  camera.verticalFov =
      static_cast<float>(2.0 * std::atan(taller * std::tan(0.5 * double{camera.verticalFov})));
  return camera;
}

}  // namespace trex
