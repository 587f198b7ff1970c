// Infinite lights of pbrt as one environment.
#pragma once

#include <optional>
#include <vector>

#include "src/scene/scene.h"

namespace trex::detail {

/// The point of the unit square where pbrt-v4's equal-area octahedral maps hold a direction (unit),
/// (0, 0) being the corner of the image's first texel [Clarberg, EGSR 2008].
glm::dvec2 equalAreaSquare(const dvec3& direction);
/// The inverse.
dvec3 equalAreaDirection(const glm::dvec2& square);

class PbrtSky {
 public:
  /// A picture of three float channels around the scene. pbrt-v3's is latitude-longitude around +z
  /// of the light, phi from +x on, the top row at +z; pbrt-v4's is square.
  struct Map {
    Image image;
    bool square = false;
    glm::dmat3 toWorld{1.0};
    vec3 factor{1.0f};
    /// Radiance from a direction in the light's own space.
    vec3 at(const dvec3& direction) const;
    /// Illuminance of a surface that faces the light's +z.
    double illuminance() const;
  };

  bool present() const { return constant_ != vec3(0.0f) || !maps_.empty(); }
  void add(const vec3& radiance) { constant_ += radiance; }
  void add(Map map) { maps_.push_back(std::move(map)); }

  /// All of it; `mirror` turns pbrt's world into ours. Maps are looked up anew for each texel of a
  /// latitude-longitude map of as many rows, at four places.
  Environment environment(const glm::dmat3& mirror) const;

 private:
  vec3 constant_{0.0f};
  std::vector<Map> maps_;
};

}  // namespace trex::detail
