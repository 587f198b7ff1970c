// Vertex normals of meshes that come without.
#pragma once

#include "src/scene/scene.h"

namespace trex::detail {

/// Normals of vertices: the mean of their faces', weighted by the angles at the vertex [Thuermer,
/// Wuethrich 1998].
void makeSmoothNormals(Mesh& mesh);

/// The same over faces that meet at less than an angle (radians), corners at equal places taken
/// together; elsewhere the surface has an edge. Vertices are split as needed. Where more than 512
/// corners meet, faces are flat.
void makeNormalsByAngle(Mesh& mesh, double largestAngle);

}  // namespace trex::detail
