// Shapes of a Mitsuba scene, placed and with their materials.
#pragma once

#include <map>
#include <tuple>

#include "src/scene/mitsuba_bsdfs.h"
#include "src/scene/mitsuba_geometry.h"

namespace trex::detail::mitsuba {

class Shapes {
 public:
  Shapes(Context& context, Textures& textures, Bsdfs& bsdfs)
      : context_(context), textures_(textures), bsdfs_(bsdfs) {}

  /// Adds a shape of the scene: its meshes, or those of the group that it is an instance of.
  void add(const Element& shape);

 private:
  /// A mesh in the space of a shape or group.
  struct Part {
    int mesh = 0;
    dmat4 transform{1.0};
  };
  using Parts = std::vector<Part>;
  /// What decides a shape's material.
  struct Surface {
    const Element* bsdf = nullptr;
    const Element* emitter = nullptr;
    const Element* interior = nullptr;
    Look look;
  };

  void checkCount(const Element& at, std::size_t more);
  void limitDetail(const Properties& shape, Geometry& geometry);
  Parts partsOf(const Element& shape, int depth);
  Parts partsOfGroup(const Properties& group, int depth);
  Parts partsOfInstance(const Properties& instance, int depth);
  Parts partsOfMesh(const Properties& shape);
  /// Meshes of a geometry, made once; empty if it is broken, which is told.
  const std::vector<int>& meshesOf(const Properties& shape, const Geometry& geometry);
  /// That mesh with a material: itself, or another of the same triangles.
  int withMaterial(int mesh, int material);
  int materialOf(const Properties& shape, const Surface& surface, int mesh, const dmat4& place);
  Surface surfaceOf(const Properties& shape);
  Material makeMaterial(const Properties& shape, const Surface& surface, const UvFacts& facts);
  void setEmission(const Element& emitter, Material& m);
  void setInterior(const Element& medium, Material& m);
  const Element* first(const Properties& shape, std::string_view tag) const;

  Context& context_;
  Textures& textures_;
  Bsdfs& bsdfs_;
  std::map<std::string, std::vector<int>> geometries_;  ///< meshes by key
  std::map<std::pair<int, int>, int> meshes_;           ///< by the first mesh and material
  std::map<std::string, int> materials_;
  std::map<const Element*, Parts> groups_;
};

}  // namespace trex::detail::mitsuba
