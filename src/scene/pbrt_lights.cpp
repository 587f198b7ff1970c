#include "src/scene/pbrt_lights.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "src/scene/image_io.h"
#include "src/scene/texture_file.h"

namespace trex::detail {
namespace {

constexpr int kMaxMapWidth = 32768;

dvec3 transformed(const dmat4& m, const dvec3& p) { return dvec3(m * glm::dvec4(p, 1.0)); }

}  // namespace

double pbrtInnerCosine(double cosStart, double cosEnd, bool version4) {
  // Means between the cones: pbrt-v3 t^4: 1/5, pbrt-v4 smoothstep: 1/2, glTF t^2: 1/3.
  const double mean = version4 ? 0.5 : 0.2;
  const double cosine = cosEnd + (cosStart - cosEnd) * (1.0 - mean) * 1.5;
  return std::min(cosine, 1.0);
}

/// The parameter times `scale`, in the picture's units.
vec3 PbrtLights::amount(const PbrtParameters& p, std::string_view name) {
  const vec3 scale = colors_.reflectance(p, "scale").value_or(vec3(1.0f));
  return colors_.light(p, name).value_or(vec3(1.0f)) * glm::max(scale, vec3(0.0f)) * lightScale;
}

void PbrtLights::add(const std::string& kind, const PbrtParameters& parameters,
                     const PbrtState& state) {
  const dmat4& toWorld = state.ctm[0];
  parameters.ignore({"samples", "nsamples"});
  if (!isPlacement(toWorld)) {
    context_.replace("its transform is not finite, flat or not affine; it is left out");
    parameters.ignoreAll();
  } else if (kind == "point" || kind == "goniometric") {
    addPoint(parameters, toWorld, kind == "goniometric");
  } else if (kind == "spot" || kind == "projection") {
    addSpot(kind, parameters, toWorld);
  } else if (kind == "distant") {
    addDistant(parameters, toWorld);
  } else if (kind == "infinite" || kind == "exinfinite") {
    addInfinite(parameters, toWorld);
  } else {
    context_.replace("lights of this kind are not known; it is left out");
    parameters.ignoreAll();
  }
}

void PbrtLights::push(Light light) {
  light.intensity = clampedLight(light.intensity);
  context_.scene.lights.push_back(std::move(light));
}

/// Luminance of the picture that a light shines through; 1 if there is none.
float PbrtLights::meanOfMap(const PbrtParameters& p) {
  const std::string file = p.text(p.find("mapname") != nullptr ? "mapname" : "filename");
  const std::optional<Image> image = file.empty() ? std::nullopt : readMap(file);
  if (!image) return 1.0f;
  double sum = 0.0;
  for (std::size_t i = 0; i + 2 < image->floats.size(); i += 3) {
    sum += double{luminance(vec3(image->floats[i], image->floats[i + 1], image->floats[i + 2]))};
  }
  return static_cast<float>(3.0 * sum / static_cast<double>(image->floats.size()));
}

void PbrtLights::addPoint(const PbrtParameters& p, const dmat4& toWorld, bool map) {
  Light light;
  light.name = map ? "goniometric" : "point";
  light.position = transformed(toWorld, p.point("from", dvec3(0.0)));
  light.intensity = amount(p, "I");
  const double power = p.number("power", -1.0);
  if (power > 0.0) light.intensity *= static_cast<float>(power / (4.0 * std::numbers::pi));
  if (map) {
    const float mean = meanOfMap(p);
    if (!(power > 0.0)) light.intensity *= mean;
    context_.replace("its picture is not shown; it shines the same everywhere");
  }
  push(light);
}

void PbrtLights::addSpot(const std::string& kind, const PbrtParameters& p, const dmat4& toWorld) {
  const bool projects = kind == "projection";
  Light light;
  light.type = Light::Type::kSpot;
  light.name = kind;
  const dvec3 from = p.point("from", dvec3(0.0)), to = p.point("to", dvec3(0.0, 0.0, 1.0));
  const dvec3 along = glm::dmat3(toWorld) * (to - from);
  if (!std::isnormal(glm::length(along))) {
    context_.replace("it shines in no direction; it is left out");
    return;
  }
  light.position = transformed(toWorld, from);
  light.direction = vec3(glm::normalize(along));
  const double cone = projects ? 0.5 * p.number("fov", colors_.version4 ? 90.0 : 45.0)
                               : p.number("coneangle", 30.0);
  const double delta = projects ? 0.0 : p.number("conedeltaangle", 5.0);
  const double end = glm::radians(std::clamp(cone, 0.1, 179.0));
  const double start = glm::radians(std::clamp(cone - delta, 0.0, std::clamp(cone, 0.1, 179.0)));
  const double inner = pbrtInnerCosine(std::cos(start), std::cos(end), colors_.version4);
  light.outerConeAngle = static_cast<float>(end);
  light.innerConeAngle = static_cast<float>(std::min(std::acos(inner), end));
  light.intensity = amount(p, "I");
  if (const double power = p.number("power", -1.0); power > 0.0) {
    const double angle = 2.0 * std::numbers::pi * (1.0 - 0.5 * (std::cos(start) + std::cos(end)));
    light.intensity *= static_cast<float>(power / angle);
  }
  if (projects) {
    light.intensity *= meanOfMap(p);
    context_.replace("its picture is not shown; it is a spot of its mean");
  }
  push(light);
}

void PbrtLights::addDistant(const PbrtParameters& p, const dmat4& toWorld) {
  Light light;
  light.type = Light::Type::kDirectional;
  light.name = "distant";
  const dvec3 from = p.point("from", dvec3(0.0)), to = p.point("to", dvec3(0.0, 0.0, 1.0));
  const dvec3 along = glm::dmat3(toWorld) * (to - from);
  if (!std::isnormal(glm::length(along))) {
    context_.replace("it shines in no direction; it is left out");
    return;
  }
  light.direction = vec3(glm::normalize(along));
  light.intensity = amount(p, "L");
  const double illuminance = p.number("illuminance", -1.0);
  if (illuminance > 0.0) light.intensity *= static_cast<float>(illuminance);
  push(light);
}

std::optional<Image> PbrtLights::readMap(const std::string& file) {
  const std::filesystem::path path = findFile(context_.folder, file);
  try {
    Image image = readFloatImage(path, kMaxMapWidth);
    context_.note(path);
    return image;
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput) throw;
    context_.replace("{}; white is shown instead", e.what());
    return {};
  }
}

void PbrtLights::addInfinite(const PbrtParameters& p, const dmat4& toWorld) {
  const vec3 radiance = amount(p, "L");
  const double illuminance = p.number("illuminance", -1.0);
  if (p.find("portal") != nullptr) context_.replace("its portal is not shown; all of it shines");
  const bool version4 = p.find("filename") != nullptr;
  const std::string file = p.text(version4 ? "filename" : "mapname");
  std::optional<Image> image = file.empty() ? std::nullopt : readMap(file);
  if (!image) {
    const double factor = illuminance > 0.0 ? illuminance / std::numbers::pi : 1.0;
    sky.add(clampedLight(radiance * static_cast<float>(factor)));
    return;
  }
  PbrtSky::Map map{std::move(*image), version4, glm::dmat3(toWorld), radiance};
  if (version4 && map.image.width != map.image.height) {
    context_.replace("its picture is not square; it is taken for a latitude-longitude one");
    map.square = false;
  }
  if (const double own = illuminance > 0.0 && map.square ? map.illuminance() : 0.0; own > 0.0) {
    map.factor *= static_cast<float>(illuminance / own);
  }
  map.factor = clampedLight(map.factor);
  sky.add(std::move(map));
}

}  // namespace trex::detail
