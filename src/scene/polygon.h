// Polygons as OBJ and PLY files have them: any number of corners, concave, not quite plane.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"

namespace trex::detail {

/// Cuts polygons into triangles. Not thread safe; keeps its memory from one polygon to the next.
class PolygonCutter {
 public:
  /// Triangles of a polygon with these corners, as indices into them, the polygon's way around;
  /// valid until the next call. A convex polygon becomes the fan around its first corner, others
  /// are cut ear by ear [Meisters, American Mathematical Monthly 1975] in the plane of their mean
  /// normal. What is left when no ear is found (the outline crosses itself, or has far too many
  /// corners) becomes a fan, and failed() is true. Fewer than 3 corners: no triangles.
  std::span<const glm::uvec3> cut(std::span<const dvec3> corners);

  /// Of the last polygon.
  bool failed() const { return failed_; }

 private:
  using Vec = glm::dvec2;
  double cross(std::uint32_t a, std::uint32_t b, std::uint32_t c) const;
  bool project(std::span<const dvec3> corners);
  bool convex() const;
  bool isEar(std::uint32_t corner);
  void fan(std::uint32_t first);
  void clip();

  std::vector<Vec> flat_;  ///< corners in the plane, counter-clockwise
  std::vector<std::uint32_t> before_, after_, reflex_;
  std::vector<glm::uvec3> triangles_;
  std::uint64_t work_ = 0;
  bool failed_ = false;
};

}  // namespace trex::detail
