// What the sources of LightSet and those who follow photons share. Not for other files.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "src/core/maths.h"
#include "src/scene/scene.h"

namespace trex {

/// Cones narrower than this, radians, are no matter of a float's cosines.
constexpr float kNarrowCone = 0.03f;

inline bool isNarrow(const Light& light) {
  return light.type == Light::Type::kSpot && light.outerConeAngle <= kNarrowCone;
}

/// 1 - cosine of the edge of what a spot sends out; 2 of a point light.
inline float coneVersine(const Light& light) {
  if (light.type != Light::Type::kSpot) return 2.0f;
  if (!isNarrow(light)) return 1.0f - std::cos(light.outerConeAngle);
  const float sine = std::sin(0.5f * light.outerConeAngle);
  return 2.0f * sine * sine;
}

/// A direction of a point or spot light about +z, even per solid angle; u in [0, 1)^2.
inline vec3 coneDirection(const Light& light, vec2 u) {
  const float versine = u.x * coneVersine(light), cosine = 1.0f - versine;
  const float sine2 = isNarrow(light) ? versine * (2.0f - versine) : 1.0f - cosine * cosine;
  const float sine = std::sqrt(std::max(0.0f, sine2)), phi = 2.0f * kPi * u.y;
  return vec3(sine * std::cos(phi), sine * std::sin(phi), cosine);
}

/// Inverse: u.x of a unit vector about +z, above 1 outside of the cone.
inline float coneShare(const Light& light, const vec3& d) {
  const float versine =
      isNarrow(light) && d.z > 0.0f ? (d.x * d.x + d.y * d.y) / (1.0f + d.z) : 1.0f - d.z;
  return versine / coneVersine(light);
}

/// Falloff of KHR_lights_punctual: 1 inside the inner cone, 0 outside the outer one. `cosine`, and
/// `versine`, 1 - cosine, of the direction to the axis. The extension's formula holds the cones'
/// cosines at least 0.001 apart. Where they are closer (beams below 2.6 degrees, hard edges) that
/// would take light from the inner cone.
inline float spotFactor(const Light& light, float cosine, float versine) {
  if (light.type != Light::Type::kSpot) return 1.0f;
  const float outer = std::cos(light.outerConeAngle);
  const float gap = std::cos(light.innerConeAngle) - outer;
  float x = (cosine - outer) * (1.0f / std::max(0.001f, gap));
  if (gap < 0.001f) {
    const float ramp = 2.0f * std::sin(0.5f * (light.outerConeAngle - light.innerConeAngle)) *
                       std::sin(0.5f * (light.outerConeAngle + light.innerConeAngle));
    x = (coneVersine(light) - versine) / std::max(ramp, 1e-30f);
  }
  x = std::clamp(x, 0.0f, 1.0f);
  return x * x;
}

/// The same of a unit vector from the light.
inline float spotFactor(const Light& light, const vec3& direction) {
  const vec3 apart = direction - light.direction;
  return spotFactor(light, glm::dot(direction, light.direction), 0.5f * glm::dot(apart, apart));
}

/// What a range cuts smoothly off the inverse square law (KHR_lights_punctual); 0: there is none.
inline float rangeFactor(float range, float distance) {
  if (!std::isfinite(range) || range <= 0.0f) return 1.0f;
  const float r = distance / range;
  return std::clamp(1.0f - r * r * r * r, 0.0f, 1.0f);
}

/// The range of a light on a photon's way: cuts its power where it first meets what scatters,
/// reflects or bends it, as light sampling there does.
class RangeOnTheWay {
 public:
  explicit RangeOnTheWay(float range) : range_(range) {}
  /// The photon has gone on straight.
  void advance(float distance) { travelled_ += distance; }
  /// Of what lands where the photon is.
  float factor() const { return rangeFactor(range_, travelled_); }
  /// The photon turns where it is; its power takes this, later ones nothing.
  float end() {
    const float here = factor();
    range_ = kInfinity;
    return here;
  }

 private:
  float range_, travelled_ = 0.0f;
};

inline vec3 uniformSphere(vec2 u) {
  const float z = 1.0f - 2.0f * u.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  return vec3(r * std::cos(2.0f * kPi * u.y), r * std::sin(2.0f * kPi * u.y), z);
}

/// A number in [0, 1) of more digits than a float: a choice among millions leaves some of it.
inline double longNumber(double first, double second) { return first + 0x1p-24 * second; }
inline double longNumber(const vec2& u) { return longNumber(u.x, u.y); }

/// Sums before each weight, and the total.
inline std::vector<double> cumulate(const std::vector<double>& weights) {
  std::vector<double> sums(weights.size() + 1, 0.0);
  for (std::size_t i = 0; i < weights.size(); ++i) sums[i + 1] = sums[i] + weights[i];
  return sums;
}

}  // namespace trex
