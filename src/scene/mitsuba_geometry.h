// The triangles of a Mitsuba scene's shapes, without their places and materials.
#pragma once

#include "src/scene/mitsuba_context.h"
#include "src/scene/shape_meshes.h"

namespace trex::detail::mitsuba {

/// What a shape's triangles are made of.
struct Geometry {
  std::string key;   ///< equal for equal triangles
  std::string kind;  ///< the shape's type
  std::string file;  ///< of obj, ply and serialized
  bool faceNormals = false, flip = false, flipV = false;
  bool mirrored = false;       ///< by the shape's transform
  bool colored = false;        ///< vertices keep the colours of the file
  double smoothAngle = -1.0;   ///< radians; negative: all
  std::uint32_t index = 0;     ///< in a serialized file
  double error = kShapeError;  ///< of round shapes
  dmat4 place{1.0};            ///< from the triangles to the shape's own space

  /// Faces of files without normals show the side that their corners turn about, as placed.
  void setMirrored(bool isMirrored);
  void setColored(bool isColored);
  void setError(double value);
};

/// False, and told, if a shape is of a kind that is not known.
bool describeGeometry(const Properties& shape, Geometry& out);

/// The triangles. Throws Error(kInput) if the file is missing or broken; front faces are those
/// that Mitsuba takes for them.
std::vector<Mesh> makeGeometry(Context& context, const Element& at, const Geometry& geometry);

/// Mesh `index` of a serialized file; `where` names the element for messages.
Mesh readSerialized(const std::filesystem::path& path, std::uint32_t index,
                    const std::string& where);

}  // namespace trex::detail::mitsuba
