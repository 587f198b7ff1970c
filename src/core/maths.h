// Small vector maths shared by all of src/. GLM supplies the types.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <numbers>

namespace trex {

using glm::dmat4;
using glm::dvec3;
using glm::ivec2;
using glm::mat3;
using glm::mat4;
using glm::vec2;
using glm::vec3;
using glm::vec4;

inline constexpr float kPi = std::numbers::pi_v<float>;
inline constexpr float kInvPi = std::numbers::inv_pi_v<float>;
inline constexpr float kInfinity = std::numeric_limits<float>::infinity();

inline bool isFinite(const vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
inline float maxComponent(const vec3& v) { return std::max(v.x, std::max(v.y, v.z)); }

/// Relative luminance of linear Rec. 709 (the sRGB primaries).
inline float luminance(const vec3& c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

/// The transfer function of sRGB [IEC 61966-2-1]: linear to encoded and back; x in [0, 1].
inline float encodeSrgb(float x) {
  return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1.0f / 2.4f) - 0.055f;
}
inline float decodeSrgb(float x) {
  return x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f);
}
inline float decodeSrgb8(std::uint8_t byte) {
  return decodeSrgb(static_cast<float>(byte) / 255.0f);
}

/// An orthonormal basis around the unit vector n, without branches on n.z's neighbourhood
/// [Duff et al., JCGT 2017].
struct Basis {
  vec3 tangent, bitangent, normal;
  explicit Basis(const vec3& n) : normal(n) {
    const float sign = std::copysign(1.0f, n.z);
    const float a = -1.0f / (sign + n.z);
    const float b = n.x * n.y * a;
    tangent = vec3(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    bitangent = vec3(b, sign + n.y * n.y * a, -n.y);
  }
  vec3 toWorld(const vec3& v) const { return v.x * tangent + v.y * bitangent + v.z * normal; }
  vec3 toLocal(const vec3& v) const {
    return vec3(glm::dot(v, tangent), glm::dot(v, bitangent), glm::dot(v, normal));
  }
};

/// An axis-aligned box; empty when made.
template <typename Vec>
struct Box {
  using T = typename Vec::value_type;
  Vec lower = Vec(std::numeric_limits<T>::infinity());
  Vec upper = Vec(-std::numeric_limits<T>::infinity());
  void extend(const Vec& p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  void extend(const Box& b) {
    lower = glm::min(lower, b.lower);
    upper = glm::max(upper, b.upper);
  }
  bool empty() const { return !(lower.x <= upper.x); }
  Vec centre() const { return (lower + upper) * T(0.5); }
  Vec size() const { return upper - lower; }
};
using Box3f = Box<vec3>;
using Box3d = Box<dvec3>;

}  // namespace trex
