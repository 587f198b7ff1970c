// The scene's triangles as the ASVO's builder reads them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "asvo/asvo.h"
#include "src/core/maths.h"
#include "src/grays/shaderio.h"
#include "src/scene/scene.h"
#include "src/session/run_table.h"

namespace trex {

/// Every instance's triangles in render space. Surfaces that let light pass nearly unscattered
/// (smooth glass, mostly transparent coverage) are left out: photons and cones go straight through.
class VoxelSource : public asvo::TriangleSource {
 public:
  /// `materials` are copied; of the scene, instances, images and arrays of meshes are read.
  VoxelSource(const Scene& scene, std::vector<Material> materials, const dvec3& renderOrigin);
  std::uint64_t count() const override { return runs_.count(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override;
  asvo::Shade shade(const asvo::Triangle& triangle, float u, float v) const override;
  bool uniform(const asvo::Triangle& triangle) const override;

 private:
  struct Placed {
    const Mesh* mesh;
    glm::dmat3 linear;  ///< with `origin`: mesh positions to render space
    dvec3 origin;
    bool mirrored;
  };
  const Scene& scene_;
  std::vector<Material> materials_;
  std::vector<std::optional<asvo::Shade>> plain_;
  std::vector<Placed> placed_;
  RunTable runs_;  ///< triangles of each
};

/// Diffuse reflectance that a voxel keeps of a surface of this base colour: what
/// Bsdf::cachedAlbedo() has there. Zero for unlit materials.
vec3 voxelAlbedo(const Material& material, const vec3& baseColor);
/// Whether that is not nearly all of its light, as of metals and frosted glass: Bsdf::cacheable().
bool sendsByDirection(const Material& material);
/// Mean of a texture's colour, one if there is none.
vec3 meanColor(const std::vector<Image>& images, const Texture& texture);
/// The shade of a surface point; `vertexColor` multiplies the base colour. Emission is that of the
/// part that is there.
asvo::Shade voxelShade(const Material& material, const std::vector<Image>& images,
                       const TexCoords& uv, const vec4& vertexColor);
/// By material: the shade of surfaces without vertex colours, if no texture changes it.
std::vector<std::optional<asvo::Shade>> plainShades(const std::vector<Material>& materials,
                                                    const std::vector<Image>& images);

/// What photons need to know of each material when they meet a voxel.
std::vector<shaderio::PhotonMaterial> photonMaterials(const std::vector<Material>& materials,
                                                      const std::vector<Image>& images);

}  // namespace trex
