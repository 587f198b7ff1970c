// The scene's triangles as the ASVO's builder reads them.
#pragma once

#include <cstdint>
#include <vector>

#include "asvo/asvo.h"
#include "src/core/maths.h"
#include "src/grays/shaderio.h"
#include "src/scene/scene.h"

namespace trex {

/// Every instance's triangles in render space. Surfaces that let light pass nearly unscattered
/// (smooth glass, mostly transparent coverage) are left out: photons and cones go straight through.
class VoxelSource : public asvo::TriangleSource {
 public:
  VoxelSource(const Scene& scene, const dvec3& renderOrigin);
  std::uint64_t count() const override { return firsts_.back(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override;
  asvo::Shade shade(const asvo::Triangle& triangle, float u, float v) const override;

 private:
  struct Placed {
    const Mesh* mesh;
    dmat4 toRender;  ///< mesh positions (without their origin) to render space
    bool mirrored;
  };
  const Scene& scene_;
  std::vector<Placed> placed_;
  std::vector<std::uint64_t> firsts_;  ///< number of the first triangle of each, and the total
};

/// Whether light goes through a surface nearly unscattered: such are no voxels.
bool passesLight(const Material& m);

/// What a point of a surface contributes to its voxel; `color`: the vertices'.
asvo::Shade shadeOf(const Scene& scene, std::uint32_t material, vec2 uv, const vec3& color);

/// What photons need to know of each material when they meet a voxel.
std::vector<shaderio::PhotonMaterial> photonMaterials(const Scene& scene);

}  // namespace trex
