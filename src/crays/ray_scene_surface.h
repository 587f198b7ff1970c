// From a decoded triangle to a point on the surface, in render space.
#pragma once

#include "src/crays/ray_scene.h"

namespace trex {

/// Where a mesh stands in render space.
struct Placement {
  dmat4 toRender{1.0}, toMesh{1.0};
  glm::dmat3 normalMatrix{1.0};  ///< to render space, up to a positive factor
  bool moved = false;            ///< toRender is not the identity
  bool mirrored = false;         ///< counter-clockwise in mesh space is clockwise here
  int object = kNone;            ///< overrides the triangle's unless kNone
  double slack = 0x1p-49;  ///< mesh units: rounding of a point on its way there, a metre of...
  double far = 0.0;        ///< ...its largest coordinate and this one, which is the place's
  double embreeSlack = 0x1p-19;  ///< mesh units: the same by Embree's single precision, which culls

  /// False if rays cannot be brought to mesh space.
  static bool make(const dmat4& transform, int object, Placement& out);
  /// A ray in mesh space, with t as in render space. `step` is the mesh's grid, in its own units.
  hccm::Ray rayToMesh(const RayStart& start, const vec3& direction, float tnear, float tfar,
                      const RayEnd& end, double step) const;
};

/// What a triangle interpolates besides its place and normals: texture coordinates, colour.
void readAttributes(const hccm::Triangle& triangle, const RayHit& hit, Surface& surface);

/// Never non-finite, also for triangles without area.
Surface makeSurface(const hccm::Triangle& triangle, const Placement& placement, const RayHit& hit);

}  // namespace trex
