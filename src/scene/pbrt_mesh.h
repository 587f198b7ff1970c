// Shapes of pbrt as triangles, in the shape's own space.
#pragma once

#include <optional>

#include "src/scene/pbrt_context.h"
#include "src/scene/shape_meshes.h"

namespace trex::detail {

/// How shapes are turned into triangles.
struct PbrtFaces {
  bool reverse = false;   ///< fronts are on the other side
  bool version4 = false;  ///< normals that are given turn with them
  bool textured = false;  ///< pbrt's default texture coordinates are wanted if there are none
};

/// A trianglemesh or bilinearmesh; nothing, which is said, if the shape is of another kind or has
/// no triangle. A face's front is where pbrt's surface normal points: by the corners' order, by the
/// normals if there are any. Texture coordinates are (u, 1 - v).
std::optional<Mesh> pbrtMesh(PbrtContext& context, const std::string& kind,
                             const PbrtParameters& parameters, const PbrtFaces& faces);

/// A sphere, disk or cylinder: one of radius 1 that is scaled and moved.
struct PbrtQuadric {
  std::string kind;
  Revolved part;
  double innerRadius = 0.0;
  dmat4 placement{1.0};

  /// Of what its mesh depends on.
  std::string key() const;
  Mesh mesh(bool reverse, double error) const;  ///< see kShapeError
};
bool isPbrtQuadric(const std::string& kind);
/// Nothing if its radius is none, which is said.
std::optional<PbrtQuadric> pbrtQuadric(PbrtContext& context, const std::string& kind,
                                       const PbrtParameters& parameters);

/// The mesh of a PLY file, which pbrt reads without its colours.
std::optional<Mesh> pbrtPlyMesh(PbrtContext& context, const std::string& file,
                                const PbrtFaces& faces);

}  // namespace trex::detail
