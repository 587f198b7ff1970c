#include "src/scene/daylight.h"

#include <algorithm>
#include <array>
#include <numbers>

#include "src/scene/spectra.h"

namespace trex::detail {
namespace {

constexpr double kHalfTurn = std::numbers::pi;
constexpr std::array<double, 5> kTurbidities = {2.0, 3.0, 4.0, 6.0, 10.0};
constexpr std::array<double, 6> kHeights = {2.0, 10.0, 25.0, 45.0, 65.0, 89.0};  // degrees
using Table = std::array<vec3, kTurbidities.size() * kHeights.size()>;

/// Irradiance of level ground by the sky, for each turbidity and height of the sun.
constexpr Table kSky = {{
    vec3(0.0527f, 0.0597f, 0.0568f), vec3(0.0813f, 0.1244f, 0.1692f),
    vec3(0.1078f, 0.1832f, 0.2969f), vec3(0.1250f, 0.2188f, 0.3991f),
    vec3(0.1374f, 0.2372f, 0.4445f), vec3(0.1475f, 0.2645f, 0.4585f),
    vec3(0.0563f, 0.0605f, 0.0564f), vec3(0.0968f, 0.1352f, 0.1713f),
    vec3(0.1354f, 0.2058f, 0.3073f), vec3(0.1608f, 0.2510f, 0.4208f),
    vec3(0.1711f, 0.2720f, 0.4710f), vec3(0.1981f, 0.2938f, 0.4716f),
    vec3(0.0598f, 0.0609f, 0.0556f), vec3(0.1201f, 0.1509f, 0.1749f),
    vec3(0.1802f, 0.2409f, 0.3219f), vec3(0.2186f, 0.3010f, 0.4548f),
    vec3(0.2273f, 0.3274f, 0.5202f), vec3(0.2490f, 0.3370f, 0.5025f),
    vec3(0.0627f, 0.0613f, 0.0541f), vec3(0.1546f, 0.1710f, 0.1790f),
    vec3(0.2497f, 0.2916f, 0.3439f), vec3(0.3156f, 0.3896f, 0.5130f),
    vec3(0.3330f, 0.4259f, 0.5943f), vec3(0.3552f, 0.4401f, 0.5414f),
    vec3(0.0551f, 0.0503f, 0.0439f), vec3(0.2055f, 0.1884f, 0.1713f),
    vec3(0.4318f, 0.4200f, 0.4044f), vec3(0.7835f, 0.7716f, 0.7508f),
    vec3(0.9389f, 0.9855f, 0.9551f), vec3(0.7530f, 0.7862f, 0.7888f),
}};
/// Irradiance of a surface that faces the sun.
constexpr Table kSun = {{
    vec3(0.3845f, 0.1073f, 0.0f),    vec3(1.0890f, 0.6654f, 0.2362f),
    vec3(1.3976f, 1.0742f, 0.6704f), vec3(1.5001f, 1.2349f, 0.9082f),
    vec3(1.5352f, 1.2927f, 1.0035f), vec3(1.5470f, 1.3123f, 1.0373f),
    vec3(0.2623f, 0.0708f, 0.0f),    vec3(0.9955f, 0.6037f, 0.2157f),
    vec3(1.3475f, 1.0316f, 0.6454f), vec3(1.4677f, 1.2055f, 0.8879f),
    vec3(1.5093f, 1.2687f, 0.9857f), vec3(1.5235f, 1.2903f, 1.0206f),
    vec3(0.1398f, 0.0357f, 0.0f),    vec3(0.8590f, 0.5144f, 0.1857f),
    vec3(1.2686f, 0.9653f, 0.6059f), vec3(1.4160f, 1.1587f, 0.8550f),
    vec3(1.4677f, 1.2299f, 0.9573f), vec3(1.4852f, 1.2545f, 0.9937f),
    vec3(0.0401f, 0.0091f, 0.0f),    vec3(0.6538f, 0.3824f, 0.1407f),
    vec3(1.1344f, 0.8534f, 0.5390f), vec3(1.3249f, 1.0763f, 0.7972f),
    vec3(1.3935f, 1.1614f, 0.9065f), vec3(1.4169f, 1.1909f, 0.9457f),
    vec3(0.0000f, 0.0000f, 0.0f),    vec3(0.1053f, 0.0527f, 0.0219f),
    vec3(0.5301f, 0.3693f, 0.2433f), vec3(0.8416f, 0.6521f, 0.4956f),
    vec3(0.9787f, 0.7855f, 0.6256f), vec3(1.0285f, 0.8354f, 0.6760f),
}};

/// Index of the cell that holds a value, and the place in it from 0 to 1.
template <std::size_t N>
std::pair<std::size_t, float> cellOf(const std::array<double, N>& grid, double value) {
  value = std::clamp(value, grid.front(), grid.back());
  std::size_t i = 0;
  while (i + 2 < N && value > grid[i + 1]) ++i;
  return {i, static_cast<float>((value - grid[i]) / (grid[i + 1] - grid[i]))};
}

vec3 lookUp(const Table& table, double turbidity, double height) {
  const auto [t, a] = cellOf(kTurbidities, turbidity);
  const auto [h, b] = cellOf(kHeights, height);
  const auto at = [&](std::size_t i, std::size_t j) { return table[i * kHeights.size() + j]; };
  return glm::mix(glm::mix(at(t, h), at(t, h + 1), b), glm::mix(at(t + 1, h), at(t + 1, h + 1), b),
                  a);
}

/// Degrees over the horizon.
double heightOf(const Daylight& day) {
  return 90.0 - glm::degrees(std::acos(std::clamp(glm::dot(day.sun, day.up), -1.0, 1.0)));
}

/// Perez's pattern of one of Y, x, y.
struct Perez {
  double a, b, c, d, e, zenith, atZenith;

  Perez(const std::array<double, 10>& fit, double turbidity, double zenithValue, double sunAngle)
      : a(fit[0] * turbidity + fit[1]),
        b(fit[2] * turbidity + fit[3]),
        c(fit[4] * turbidity + fit[5]),
        d(fit[6] * turbidity + fit[7]),
        e(fit[8] * turbidity + fit[9]),
        zenith(zenithValue),
        atZenith(shape(1.0, sunAngle)) {}

  double shape(double cosine, double fromSun) const {
    const double cosSun = std::cos(fromSun);
    return (1.0 + a * std::exp(b / std::max(cosine, 1e-3))) *
           (1.0 + c * std::exp(d * fromSun) + e * cosSun * cosSun);
  }
  double at(double cosine, double fromSun) const {
    return zenith * shape(cosine, fromSun) / atZenith;
  }
};

double cubic(double x, double a, double b, double c, double d) {
  return ((a * x + b) * x + c) * x + d;
}

class Sky {
 public:
  Sky(double turbidity, double sunAngle)
      : luminance_(
            {0.1787, -1.4630, -0.3554, 0.4275, -0.0227, 5.3251, 0.1206, -2.5771, -0.0670, 0.3703},
            turbidity, 1.0, sunAngle),
        x_({-0.0193, -0.2592, -0.0665, 0.0008, -0.0004, 0.2125, -0.0641, -0.8989, -0.0033, 0.0452},
           turbidity,
           turbidity * turbidity * cubic(sunAngle, 0.00166, -0.00375, 0.00209, 0.0) +
               turbidity * cubic(sunAngle, -0.02903, 0.06377, -0.03202, 0.00394) +
               cubic(sunAngle, 0.11693, -0.21196, 0.06052, 0.25886),
           sunAngle),
        y_({-0.0167, -0.2608, -0.0950, 0.0092, -0.0079, 0.2102, -0.0441, -1.6537, -0.0109, 0.0529},
           turbidity,
           turbidity * turbidity * cubic(sunAngle, 0.00275, -0.00610, 0.00317, 0.0) +
               turbidity * cubic(sunAngle, -0.04214, 0.08970, -0.04153, 0.00516) +
               cubic(sunAngle, 0.15346, -0.26756, 0.06670, 0.26688),
           sunAngle) {}

  vec3 at(double cosine, double fromSun) const {
    const double brightness = luminance_.at(cosine, fromSun);
    const double x = x_.at(cosine, fromSun), y = std::max(y_.at(cosine, fromSun), 1e-3);
    const dvec3 xyz(brightness * x / y, brightness, brightness * (1.0 - x - y) / y);
    return glm::max(vec3(rgbOfXyz(xyz)), vec3(0.0f));
  }

 private:
  Perez luminance_, x_, y_;
};

dvec3 directionOf(int x, int y, int width, int height) {
  const double theta = kHalfTurn * (y + 0.5) / height;
  const double phi = 2.0 * kHalfTurn * ((x + 0.5) / width - 0.5);
  return {std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi)};
}

double solidAngleOf(int y, int width, int height) {
  return 2.0 * kHalfTurn / width *
         (std::cos(kHalfTurn * y / height) - std::cos(kHalfTurn * (y + 1) / height));
}

double angleBetween(const dvec3& a, const dvec3& b) {
  return std::acos(std::clamp(glm::dot(a, b), -1.0, 1.0));
}

/// Fills the map with the sky, scaled to its irradiance.
void paintSky(Image& map, const Daylight& day) {
  const double height = std::max(heightOf(day), 0.0);
  const Sky sky(day.turbidity, glm::radians(90.0 - height));
  dvec3 irradiance(0.0);
  std::size_t at = 0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x, at += 3) {
      const dvec3 d = directionOf(x, y, map.width, map.height);
      const double cosine = glm::dot(d, day.up);
      if (!(cosine > 0.0)) continue;
      const vec3 radiance = sky.at(cosine, angleBetween(d, day.sun));
      for (int c = 0; c < 3; ++c) map.floats[at + c] = radiance[c];
      irradiance += dvec3(radiance) * cosine * solidAngleOf(y, map.width, map.height);
    }
  }
  const vec3 wanted = lookUp(kSky, day.turbidity, height) * static_cast<float>(day.skyScale);
  for (std::size_t i = 0; i < map.floats.size(); ++i) {
    const int c = static_cast<int>(i % 3);
    if (irradiance[c] > 0.0) map.floats[i] *= wanted[c] / static_cast<float>(irradiance[c]);
  }
}

/// Adds the sun's disk, all of it with one radiance.
void paintSun(Image& map, const Daylight& day) {
  std::vector<std::size_t> texels;
  double solidAngle = 0.0;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      if (angleBetween(directionOf(x, y, map.width, map.height), day.sun) > day.sunRadius) continue;
      texels.push_back(3 * (std::size_t(y) * map.width + x));
      solidAngle += solidAngleOf(y, map.width, map.height);
    }
  }
  const vec3 radiance = sunIrradiance(day) / static_cast<float>(std::max(solidAngle, 1e-12));
  for (const std::size_t at : texels) {
    for (int c = 0; c < 3; ++c) map.floats[at + c] += radiance[c];
  }
}

}  // namespace

vec3 sunIrradiance(const Daylight& day) {
  const double height = heightOf(day);
  if (height <= 0.0) return vec3(0.0f);
  return lookUp(kSun, day.turbidity, height) * static_cast<float>(day.sunScale);
}

Environment daylightSky(const Daylight& day, bool withSun) {
  auto map = std::make_shared<Image>();
  map->name = "daylight";
  map->width = 1024, map->height = 512, map->channels = 3;
  map->floats.resize(std::size_t(map->width) * map->height * 3);
  if (day.skyScale > 0.0) paintSky(*map, day);
  if (withSun) paintSun(*map, day);
  Environment environment;
  environment.color = vec3(1.0f);
  environment.map = std::move(map);
  return environment;
}

}  // namespace trex::detail
