#include "src/scene/pbrt_camera.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_inverse.hpp>

#include "src/scene/import_detail.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

struct Window {
  double x0, x1, y0, y1;
};

Window windowOf(const PbrtParameters& p, double aspect) {
  const std::span<const double> given = p.numbers("screenwindow");
  const bool bounded =
      std::all_of(given.begin(), given.end(), [](double v) { return std::abs(v) < 1e9; });
  if (given.size() == 4 && bounded && given[1] > given[0] && given[3] > given[2]) {
    return {given[0], given[1], given[2], given[3]};
  }
  const double x = std::max(aspect, 1.0), y = std::max(1.0 / aspect, 1.0);
  return {-x, x, -y, y};
}

/// A thin lens of a radius that is sharp at a distance, both metres; none if it has no sense.
void setLens(double radius, double focus, Camera& made) {
  const double fstop =
      double{Camera::kSensorHeight} / (4.0 * std::tan(0.5 * double{made.verticalFov}) * radius);
  if (!(radius > 0.0 && focus > 1e-6 && focus <= kMaxCoordinate) || !(fstop < 1e9)) return;
  made.fstop = static_cast<float>(fstop);
  made.focus = static_cast<float>(focus);
}

}  // namespace

void PbrtCamera::film(const std::string& kind, PbrtParameters parameters) {
  version4Film_ = kind != "image";
  film_ = std::move(parameters);
  if (film_.find("cropwindow") != nullptr || film_.find("pixelbounds") != nullptr) {
    context_.replace("its crop is not shown; the whole picture is");
  }
  const std::string sensor = film_.text("sensor", "cie1931");
  if (sensor != "cie1931") {
    context_.replace("the sensor '{:.40}' is not shown; colours are those of the eye", sensor);
  }
}

void PbrtCamera::camera(const std::string& kind, PbrtParameters parameters,
                        const PbrtState& state) {
  if (!isPlacement(state.ctm[0])) {
    context_.replace("its transform is not finite, flat or not affine; it is left out");
    return;
  }
  if (state.moves()) context_.replace("it moves; it is shown as when the shutter opens");
  kind_ = kind;
  file_ = context_.file;
  line_ = context_.line;
  parameters_ = std::move(parameters);
  cameraToWorld_ = glm::affineInverse(state.ctm[0]);
}

float PbrtCamera::exposure() const {
  double factor = film_.number("scale", 1.0);
  if (version4Film_) {
    const double seconds =
        parameters_.number("shutterclose", 1.0) - parameters_.number("shutteropen", 0.0);
    factor *= seconds * film_.number("iso", 100.0) / 100.0;
  }
  return factor > 0.0 && factor < 1e12 ? static_cast<float>(factor) : 1.0f;
}

glm::dmat3 PbrtCamera::toWorld() const {
  const bool mirrored = glm::determinant(glm::dmat3(cameraToWorld_)) > 0.0;
  return mirrored ? glm::dmat3(-1, 0, 0, 0, 1, 0, 0, 0, 1) : glm::dmat3(1.0);
}

double PbrtCamera::aspect() const {
  const double width = film_.number("xresolution", version4Film_ ? 1280.0 : 640.0);
  const double height = film_.number("yresolution", version4Film_ ? 720.0 : 480.0);
  const double given = parameters_.number("frameaspectratio", width / height);
  return given > 1e-3 && given < 1e3 ? given : 1.0;
}

void PbrtCamera::finish() {
  if (kind_.empty()) return;
  const PbrtParameters& p = parameters_;
  context_.file = file_;
  context_.line = line_;
  context_.what = fmt::format("Camera \"{}\"", kind_);
  const glm::dmat3 ours = toWorld() * glm::dmat3(cameraToWorld_);
  const double sideways = glm::length(ours[0]), upright = glm::length(ours[1]);
  const double along = glm::length(ours[2]);
  Camera made;
  made.name = "camera";
  made.eye = toWorld() * dvec3(cameraToWorld_[3]);
  const dvec3 forward = ours[2] / along;
  made.forward = vec3(forward);
  made.up = vec3(glm::normalize(ours[1] - glm::dot(ours[1], forward) * forward));
  const Window w = windowOf(p, aspect());
  if (std::abs(w.x0 + w.x1) + std::abs(w.y0 + w.y1) > 1e-6 * (w.x1 - w.x0)) {
    context_.replace("its screen window is not shown off its centre");
  }
  const double stretch = (w.x1 - w.x0) * sideways / ((w.y1 - w.y0) * upright * aspect());
  if (std::abs(stretch - 1.0) > 1e-3) {
    context_.replace("it stretches the picture by {:.3g} sideways, which is not shown", stretch);
  }
  const double halfHeight = 0.5 * (w.y1 - w.y0);
  if (kind_ == "orthographic") {
    made.orthographic = true;
    made.orthographicHeight =
        static_cast<float>(std::clamp(2.0 * halfHeight * upright, 1e-12, kMaxCoordinate));
  } else if (kind_ == "realistic") {
    realistic(p, made);
  } else {
    perspective(p, halfHeight, upright / along, made);
    lens(p, made, sideways, along);
  }
  p.ignore({"shutteropen", "shutterclose", "frameaspectratio", "screenwindow"});
  context_.report(p);
  context_.scene.cameras.push_back(made);
}

void PbrtCamera::perspective(const PbrtParameters& p, double halfHeight, double stretch,
                             Camera& made) const {
  if (kind_ != "perspective") {
    context_.replace("a camera of this kind is not shown; a perspective one of 90 degrees is");
    made.verticalFov = 0.5f * kPi;
    p.ignore({"mapping"});
    return;
  }
  const double fov =
      p.find("halffov") != nullptr ? 2.0 * p.number("halffov", 45.0) : p.number("fov", 90.0);
  const double half = std::tan(glm::radians(0.5 * std::clamp(fov, 1e-3, 179.0)));
  made.verticalFov = static_cast<float>(2.0 * std::atan(half * halfHeight * stretch));
}

void PbrtCamera::lens(const PbrtParameters& p, Camera& made, double sideways, double along) const {
  const double radius = p.number("lensradius", 0.0) * sideways;
  const double focus = p.number("focaldistance", 1e6) * along;
  setLens(radius, focus, made);
}

/// Millimetres, of thin rays through the surfaces of a lens file: radius of curvature, thickness
/// and index behind, aperture. 50 if it can't be read.
double PbrtCamera::focalLength(const std::string& file) const {
  constexpr double kUsual = 50.0;
  const std::filesystem::path path = findFile(context_.folder, file);
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return kUsual;
  context_.note(path);
  PbrtTokens tokens(path);
  std::vector<double> values;
  double value = 0.0;
  while (tokens.next() == PbrtTokens::Kind::kWord && parseDouble(tokens.text(), value)) {
    values.push_back(value);
  }
  double height = 1.0, bent = 0.0, index = 1.0;  // `bent`: index times slope
  for (std::size_t i = 0; i + 3 < values.size(); i += 4) {
    const double radius = values[i], behind = values[i + 2] > 0.0 ? values[i + 2] : 1.0;
    if (radius != 0.0) bent -= height * (behind - index) / radius;
    index = behind;
    height += values[i + 1] * bent / index;
  }
  const double length = -1.0 / bent;
  return length > 1.0 && length < 1e4 ? length : kUsual;
}

void PbrtCamera::realistic(const PbrtParameters& p, Camera& made) const {
  const double millimetres = focalLength(p.text("lensfile"));
  const double diagonal = std::clamp(film_.number("diagonal", 35.0), 0.1, 1e4);
  const double ratio = aspect();
  const double height = diagonal / std::sqrt(1.0 + ratio * ratio);
  made.verticalFov = static_cast<float>(2.0 * std::atan(0.5 * height / millimetres));
  const double radius = 0.5e-3 * p.number("aperturediameter", 1.0);
  const double focus = p.number("focusdistance", 10.0);
  setLens(radius, focus, made);
  p.ignore({"simpleweighting", "aperture"});
  context_.replace("its lenses are shown as one thin one of {:.3g} mm", millimetres);
}

}  // namespace trex::detail
