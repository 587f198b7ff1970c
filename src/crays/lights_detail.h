// What the sources of LightSet and those who follow photons share. Not for other files.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "src/core/maths.h"
#include "src/scene/scene.h"

namespace trex {

/// Falloff of KHR_lights_punctual: 1 inside the inner cone, 0 outside the outer one.
inline float spotFactor(const Light& light, float cosine) {
  if (light.type != Light::Type::kSpot) return 1.0f;
  const float outer = std::cos(light.outerConeAngle);
  const float scale = 1.0f / std::max(0.001f, std::cos(light.innerConeAngle) - outer);
  const float x = std::clamp((cosine - outer) * scale, 0.0f, 1.0f);
  return x * x;
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
