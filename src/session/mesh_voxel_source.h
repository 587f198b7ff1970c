// What is visible of the compressed meshes, as the ASVO's builder reads it: for looks that hide
// objects, cut them, or make them clear. The source's own arrays are gone by then.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "asvo/asvo.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"
#include "src/session/run_table.h"

namespace trex {

class MeshVoxelSource : public asvo::TriangleSource {
 public:
  /// Rays, instances and images of the scene must stay as they are; materials are copied. Throws
  /// Error(kMemoryOrDevice) for more than 2^32 - 1 triangles.
  MeshVoxelSource(const RayScene& rays, const Scene& scene, std::vector<Material> materials,
                  const Visibility& visibility);
  std::uint64_t count() const override { return runTable_.count() * pieces(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override;
  asvo::Shade shade(const asvo::Triangle& triangle, float u, float v) const override;
  bool uniform(const asvo::Triangle& triangle) const override;

 private:
  struct Place {
    const hccm::Mesh* mesh;
    dmat4 toRender;
    bool mirrored;
  };
  struct Run {
    std::uint32_t place, cluster;
    bool plain;  ///< shaded as plain_ of its material
  };
  /// A plane leaves up to two triangles of one.
  std::uint64_t pieces() const { return visibility_.cut ? 2 : 1; }
  void add(const hccm::Mesh& mesh, const dmat4& toRender, int object);
  const Run& find(std::uint64_t i, std::uint32_t& triangle) const;
  void whole(std::uint64_t i, vec3 (&position)[3], hccm::Triangle& source) const;

  const std::vector<Image>& images_;
  std::vector<Material> materials_;
  std::vector<std::optional<asvo::Shade>> plain_;
  Visibility visibility_;
  std::vector<Place> places_;
  std::vector<Run> runs_;
  RunTable runTable_;  ///< triangles of each
};

}  // namespace trex
