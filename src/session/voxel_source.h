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
  /// `materials` are copied; of the scene, instances, images and arrays of meshes are read.
  VoxelSource(const Scene& scene, std::vector<Material> materials, const dvec3& renderOrigin);
  std::uint64_t count() const override { return firsts_.back(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override;
  asvo::Shade shade(const asvo::Triangle& triangle, float u, float v) const override;

 private:
  struct Placed {
    const Mesh* mesh;
    glm::dmat3 linear;  ///< with `origin`: mesh positions to render space
    dvec3 origin;
    bool mirrored;
  };
  const Scene& scene_;
  std::vector<Material> materials_;
  std::vector<Placed> placed_;
  std::vector<std::uint64_t> firsts_;  ///< number of the first triangle of each, and the total
};

/// Diffuse reflectance that a voxel keeps of a surface of this base colour: what
/// Bsdf::cachedAlbedo() has there. Zero for unlit materials.
vec3 voxelAlbedo(const Material& material, const vec3& baseColor);
/// Mean of a texture's colour, one if there is none.
vec3 meanColor(const std::vector<Image>& images, const Texture& texture);
/// The shade of a surface point; `vertexColor` multiplies the base colour. Emission is that of the
/// part that is there.
asvo::Shade voxelShade(const Material& material, const std::vector<Image>& images, vec2 uv,
                       const vec4& vertexColor);

/// What photons need to know of each material when they meet a voxel.
std::vector<shaderio::PhotonMaterial> photonMaterials(const std::vector<Material>& materials,
                                                      const std::vector<Image>& images);

}  // namespace trex
