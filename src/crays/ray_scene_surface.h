// From a decoded triangle to a point on the surface, in render space.
#pragma once

#include "src/crays/ray_scene.h"

namespace trex {

/// Where a mesh stands in render space. Made from the matrix as Embree has it (rounded to float),
/// so that surfaces and hits agree.
struct Placement {
  dmat4 toRender{1.0};
  glm::dmat3 normalMatrix{1.0};  ///< to render space, up to a positive factor
  bool mirrored = false;         ///< counter-clockwise in mesh space is clockwise here
  double error = 0.0;            ///< metres: quantisation here, and rounding of rays to mesh space
  double relativeError = 0x1p-20;  ///< of a position's size, for what rays round there
  int object = -1;                 ///< overrides the triangle's if not negative

  /// `step` is the mesh's grid in its own units. False if rays cannot be brought to mesh space.
  static bool make(const dmat4& transform, double step, int object, Placement& out);
};

/// Weights u and v of the second and third corner. Never non-finite, also for triangles without
/// area.
Surface makeSurface(const hccm::Triangle& triangle, const Placement& placement, float u, float v);

}  // namespace trex
