// What rays see of a scene: objects may be hidden, a plane may cut a part away.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "src/core/maths.h"
#include "src/scene/look.h"

namespace trex {

/// In render space. Plain data; reading is thread safe.
struct Visibility {
  std::vector<std::uint8_t> hidden;  ///< by object, 1: hidden; empty if none is
  bool cut = false;                  ///< dot(normal, p) > offset is cut away
  vec3 normal{0.0f};
  float offset = 0.0f;  ///< metres

  Visibility() = default;
  Visibility(const Look& look, std::size_t objects, const dvec3& renderOrigin) {
    if (!look.hidden.empty()) {
      hidden.assign(objects, 0);
      for (const std::uint32_t i : look.hidden) hidden[i] = 1;
    }
    if (!look.section) return;
    cut = true;
    normal = look.section->normal;
    offset = static_cast<float>(glm::dot(dvec3(normal), look.section->point - renderOrigin));
  }
  bool operator==(const Visibility&) const = default;

  /// By object, or null if none is hidden.
  const std::uint8_t* hiddenObjects() const { return hidden.empty() ? nullptr : hidden.data(); }
  bool all() const { return hidden.empty() && !cut; }
  bool shows(std::uint32_t object) const { return object >= hidden.size() || hidden[object] == 0; }
  bool keeps(const dvec3& point) const {
    return !cut || glm::dot(dvec3(normal), point) <= double(offset);
  }
  /// Shortens a ray to what the plane leaves of it. False if that is nothing.
  bool clip(const dvec3& origin, const vec3& direction, float& tnear, float& tfar) const {
    if (!cut) return true;
    const auto height = static_cast<float>(glm::dot(dvec3(normal), origin) - double(offset));
    const float slope = glm::dot(normal, direction);
    if (slope == 0.0f) return height <= 0.0f;
    const float t = -height / slope;
    if (slope > 0.0f) {
      tfar = tfar < t ? tfar : t;
    } else {
      tnear = tnear > t ? tnear : t;
    }
    return tnear <= tfar;
  }
};

}  // namespace trex
