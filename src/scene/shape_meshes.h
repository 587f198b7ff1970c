// Spheres, disks, cylinders, rectangles and cubes as triangles, for the scene formats that name
// them. Each lies in a space of its own; normals are those of the true surface, faces are
// counter-clockwise as seen from outside (a disk's and a rectangle's from +z).
//
// Texture coordinates: u runs with phi, the angle from +x towards +y, over the part that is kept;
// v as each function says. They are the surface's own parameters, which formats flip as they like.
#pragma once

#include <limits>
#include <numbers>

#include "src/scene/scene.h"

namespace trex::detail {

/// Largest distance of a triangle from the true surface, as a share of its radius.
inline constexpr double kShapeError = 5e-4;

/// The part of a surface of revolution between two heights and up to an angle. Whatever the
/// numbers, what is out of range is clamped.
struct Revolved {
  double radius = 1.0;  ///< more than 0
  double zMin = -std::numeric_limits<double>::infinity();
  double zMax = std::numeric_limits<double>::infinity();
  double phiMax = 2.0 * std::numbers::pi;  ///< radians, (0, 2 pi]
};

// Ends of the straight pieces lie a little outside the true surface, so that areas are exact, and
// with them the power of a light. `error` is kept within [1e-5, 0.1]: 8 to 703 pieces a turn.

/// About the origin, poles at +-z; v is 0 at zMin (-z) and 1 at zMax, linear in the polar angle.
Mesh sphereMesh(const Revolved& part = {}, double error = kShapeError);

/// Open, around the z axis; v is 0 at zMin and 1 at zMax. zMin and zMax must be finite.
Mesh cylinderMesh(const Revolved& part, double error = kShapeError);

/// In the plane z = height, from innerRadius to radius; v is 0 at the rim and 1 inside.
Mesh diskMesh(double radius = 1.0, double innerRadius = 0.0, double height = 0.0,
              double phiMax = 2.0 * std::numbers::pi, double error = kShapeError);

/// [-1, 1]^2 in the plane z = 0; uv from (0, 0) at (-1, -1) to (1, 1).
Mesh rectangleMesh();

/// [-1, 1]^3, faces apart; uv covers each face, as Mitsuba lays it.
Mesh cubeMesh();

}  // namespace trex::detail
