// Unit vectors in 32 bits [Cigolle et al., A Survey of Efficient Representations for Independent
// Unit Vectors, JCGT 2014].
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

namespace hccm {

inline float signOf(float x) { return x < 0.0f ? -1.0f : 1.0f; }

/// n of any length but zero, finite.
inline std::uint32_t encodeOctahedral(glm::vec3 n) {
  const float sum = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  float x = n.x / sum, y = n.y / sum;
  if (n.z < 0.0f) {
    const float oldX = x;
    x = (1.0f - std::abs(y)) * signOf(oldX);
    y = (1.0f - std::abs(oldX)) * signOf(y);
  }
  const auto pack = [](float v) {
    const auto q = static_cast<std::int16_t>(std::lround(v * 32767.0f));
    return static_cast<std::uint32_t>(static_cast<std::uint16_t>(q));
  };
  return pack(x) | pack(y) << 16;
}

inline glm::vec3 decodeOctahedral(std::uint32_t code) {
  const float x = static_cast<float>(static_cast<std::int16_t>(code & 0xffffu)) * (1.0f / 32767.0f);
  const float y = static_cast<float>(static_cast<std::int16_t>(code >> 16)) * (1.0f / 32767.0f);
  const float z = 1.0f - std::abs(x) - std::abs(y);
  glm::vec3 n(x, y, z);
  if (z < 0.0f) {
    n.x = (1.0f - std::abs(y)) * signOf(x);
    n.y = (1.0f - std::abs(x)) * signOf(y);
  }
  return glm::normalize(n);
}

}  // namespace hccm
