#include "src/scene/mitsuba_lights.h"

#include <algorithm>
#include <numbers>

#include "src/scene/daylight.h"
#include "src/scene/texture.h"

namespace trex::detail::mitsuba {
namespace {

constexpr double kPiD = std::numbers::pi;

/// A unit vector, or the fallback if there is no direction in it.
vec3 unitOr(const dvec3& v, const vec3& otherwise) {
  const double length = glm::length(v);
  return length > 0.0 && std::isfinite(length) ? vec3(v / length) : otherwise;
}

dvec3 turned(const dmat4& m, const dvec3& v) { return dvec3(m * glm::dvec4(v, 0.0)); }

/// Integral over directions of a cone's falloff over the polar angle.
template <typename Falloff>
double fluxOf(double outer, const Falloff& falloff) {
  constexpr int kSteps = 512;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double angle = outer * (i + 0.5) / kSteps;
    sum += falloff(angle) * std::sin(angle);
  }
  return sum * 2.0 * kPiD * outer / kSteps;
}

/// The inner angle with which a spot here sends out as much as one whose light falls off evenly
/// with the angle from `beam` to `outer`.
double innerAngleOf(double beam, double outer) {
  const double wanted = fluxOf(outer, [&](double a) {
    return a <= beam ? 1.0 : (outer - a) / std::max(outer - beam, 1e-9);
  });
  double low = 0.0, high = outer;
  for (int i = 0; i < 50; ++i) {
    const double inner = 0.5 * (low + high);
    const double span = std::max(std::cos(inner) - std::cos(outer), 1e-9);
    const double flux = fluxOf(outer, [&](double a) {
      const double x = std::clamp((std::cos(a) - std::cos(outer)) / span, 0.0, 1.0);
      return x * x;
    });
    (flux < wanted ? low : high) = inner;
  }
  return 0.5 * (low + high);
}

Light readPoint(const Properties& of) {
  Light light;
  const dmat4 m = of.transform("to_world");
  light.position = of.has("position")
                       ? dvec3(m * glm::dvec4(of.vector("position", dvec3(0.0)), 1.0))
                       : dvec3(m[3]);
  light.intensity = of.color("intensity", vec3(1.0f), ColorKind::kEmission);
  if (of.has("power")) {
    light.intensity =
        of.color("power", vec3(1.0f), ColorKind::kEmission) / static_cast<float>(4.0 * kPiD);
  }
  return light;
}

Light readSpot(const Properties& of) {
  Light light = readPoint(of);
  light.type = Light::Type::kSpot;
  light.direction = unitOr(turned(of.transform("to_world"), dvec3(0.0, 0.0, 1.0)), light.direction);
  const double outer = of.number("cutoff_angle", 20.0, 1e-3, 90.0);
  const double beam = of.number("beam_width", 0.75 * outer, 0.0, 90.0);
  light.outerConeAngle = static_cast<float>(glm::radians(outer));
  light.innerConeAngle =
      static_cast<float>(innerAngleOf(glm::radians(std::min(beam, outer)), glm::radians(outer)));
  if (beam < outer) {
    of.context().note(of.element(),
                      "a spot's edge falls off otherwise here; its power is the same");
  }
  if (of.has("texture")) of.context().replace(of.element(), "a spot's texture is not shown");
  return light;
}

Light readDirectional(const Properties& of) {
  Light light;
  light.type = Light::Type::kDirectional;
  const dmat4 m = of.transform("to_world");
  const dvec3 along = of.vector("direction", dvec3(0.0, 0.0, 1.0));
  light.direction = unitOr(turned(m, along), light.direction);
  light.intensity = of.color("irradiance", vec3(1.0f), ColorKind::kEmission);
  return light;
}

/// The map as seen after a transform, for those that a turn about +y does not express.
std::shared_ptr<const Image> resampled(const Image& map, const glm::dmat3& toMap) {
  auto made = std::make_shared<Image>(map);
  const Texture around{.image = 0, .wrapS = Texture::Wrap::kRepeat, .wrapT = Texture::Wrap::kClamp};
  std::size_t at = 0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const double theta = kPiD * (y + 0.5) / map.height;
      const double phi = 2.0 * kPiD * ((x + 0.5) / map.width - 0.5);
      const dvec3 d = glm::normalize(toMap * dvec3(std::sin(theta) * std::sin(phi), std::cos(theta),
                                                   -std::sin(theta) * std::cos(phi)));
      const vec2 uv(static_cast<float>(std::atan2(d.x, -d.z) / (2.0 * kPiD) + 0.5),
                    static_cast<float>(std::acos(std::clamp(d.y, -1.0, 1.0)) / kPiD));
      const vec4 value = sampleTexture(map, around, uv, false);
      for (int c = 0; c < 3; ++c) made->floats[at++] = value[c];
    }
  }
  return made;
}

void turn(Environment& environment, const dmat4& toWorld) {
  // Mitsuba's maps have +z in the middle where ours have -z.
  const glm::dmat3 linear(toWorld);
  const bool aboutY = usable(toWorld) && glm::determinant(linear) > 0.0 &&
                      std::abs(glm::normalize(linear[1]).y - 1.0) < 1e-9 &&
                      std::abs(glm::length(linear[0]) / glm::length(linear[2]) - 1.0) < 1e-6 &&
                      std::abs(linear[0].y) < 1e-6 * glm::length(linear[0]);
  if (aboutY) {
    environment.rotation = static_cast<float>(kPiD + std::atan2(-linear[0].z, linear[0].x));
  } else if (usable(toWorld)) {
    environment.map = resampled(*environment.map, glm::inverse(linear));
    environment.rotation = kPi;
  }
}

void readEnvironmentMap(const Properties& of) {
  Context& context = of.context();
  const dmat4 toWorld = of.transform("to_world");
  const double scale = of.number("scale", 1.0, 0.0, 1e12);
  const std::string name = of.text("filename");
  of.ignore({"sampling_weight", "mis_compensation", "cache", "gamma", "samples_per_axis"});
  Environment environment;
  const std::filesystem::path path = context.file(name);
  try {
    environment = parseEnvironment(path.string());
  } catch (const Error& e) {
    if (e.code() != ExitCode::kInput && e.code() != ExitCode::kUsage) throw;
    context.replace(of.element(), fmt::format("{}; a sky of 0.5 is used", e.what()));
    environment.color = vec3(0.5f);
  }
  noteFile(context.scene(), path);
  environment.color *= static_cast<float>(scale);
  if (environment.map != nullptr) turn(environment, toWorld);
  context.scene().environment = environment;
}

/// Sun and sky. Versions 0.x have y up, later ones z.
void readDaylight(const Properties& of, bool sky, bool sun) {
  Context& context = of.context();
  const bool old = context.document().version().starts_with("0.");
  const dmat4 m = of.transform("to_world");
  Daylight day;
  day.turbidity = of.number("turbidity", 3.0, 1.0, 10.0);
  const double scale = of.number("scale", 1.0, 0.0, 1e12);
  day.skyScale = sky ? of.number("sky_scale", scale, 0.0, 1e12) : 0.0;
  day.sunScale = sun ? of.number("sun_scale", scale, 0.0, 1e12) : 0.0;
  day.up = dvec3(
      unitOr(turned(m, old ? dvec3(0.0, 1.0, 0.0) : dvec3(0.0, 0.0, 1.0)), vec3(0.0f, 1.0f, 0.0f)));
  const dvec3 noon(0.0, 1.0, 1.0);  // 45 degrees high, whichever of both is up
  day.sun = dvec3(unitOr(turned(m, of.vector("sun_direction", noon)), vec3(day.up)));
  if (!of.has("sun_direction")) {
    context.replace(of.element(),
                    "the sun's place by date and time is not known; it is 45 degrees high");
  }
  day.sunRadius = glm::radians(0.5 * of.number("sun_aperture", 0.5358, 0.0, 90.0)) *
                  of.number("sun_radius_scale", 1.0, 0.0, 100.0);
  of.ignore({"albedo", "resolution", "stretch", "extend", "complex_sun", "year", "month", "day",
             "hour", "minute", "second", "latitude", "longitude", "timezone"});
  context.replace(of.element(),
                  fmt::format("'{}' is shown as a clear sky of like light: Preetham's "
                              "pattern",
                              of.element().type()));
  constexpr double kSmallest = 0.01;
  const bool disk = sun && day.sunRadius >= kSmallest;
  context.scene().environment = daylightSky(day, disk);
  if (!sun || disk) return;
  Light light;
  light.type = Light::Type::kDirectional;
  light.name = "sun";
  light.direction = -vec3(day.sun);
  light.intensity = sunIrradiance(day);
  context.scene().lights.push_back(light);
}

}  // namespace

void addEmitter(Context& context, const Element& emitter) {
  const Properties of(context, emitter);
  const std::string_view type = emitter.type();
  Scene& scene = context.scene();
  of.ignore({"sampling_weight", "scene_bounds"});
  const bool sky = type == "sky" || type == "sunsky", sun = type == "sun" || type == "sunsky";
  if ((type == "envmap" || type == "constant" || sky) && scene.environment.present()) {
    context.replace(emitter, "a second environment takes the place of the first");
  }
  if (type == "constant") {
    scene.environment = {};
    scene.environment.color = of.color("radiance", vec3(1.0f), ColorKind::kEmission);
  } else if (type == "envmap") {
    readEnvironmentMap(of);
  } else if (sky || sun) {
    readDaylight(of, sky, sun);
  } else if (type == "point" || type == "spot" || type == "directional") {
    scene.lights.push_back(type == "point"  ? readPoint(of)
                           : type == "spot" ? readSpot(of)
                                            : readDirectional(of));
    scene.lights.back().name = emitter.attribute("id");
  } else {
    context.replace(emitter, fmt::format("emitter '{:.40}' is not known; it is left out", type));
    return;
  }
  of.tellUnused();
}

}  // namespace trex::detail::mitsuba
