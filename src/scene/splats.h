// What the points of a cloud are shown as: squares across their normals, or octahedra if they have
// none, which look the same from everywhere.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "src/core/maths.h"

namespace trex::detail {

class Splats {
 public:
  /// `size`: the edge of a square, the diagonal of an octahedron.
  Splats(double size, bool normals);
  std::uint32_t corners() const { return normals_ ? 4 : 6; }
  /// Of numbers of corners, counter-clockwise as seen from where the normal points, or from
  /// outside.
  std::span<const glm::uvec3> triangles() const;
  /// From a point to the corners of its splat, of which there are corners(). A normal that says
  /// nothing is taken for +y.
  std::array<vec3, 6> around(const vec3& normal) const;
  /// "30 points are shown as octahedra of 8 triangles each, 0.01 m across".
  std::string describe(std::uint64_t points, double metres) const;

  /// Of a file with faces, behind its name.
  static constexpr const char* kNoCloud = ": it has faces, so points are not shown (--point-size)";

 private:
  double size_;
  bool normals_;
};

}  // namespace trex::detail
