#include "src/bundle/requirements.h"

#include <fmt/format.h>

#include <set>

#include "asvo/medium.h"
#include "src/core/memory.h"
#include "src/crays/ray_scene.h"
#include "src/paths/caustics.h"
#include "src/scene/import.h"
#include "src/scene/texture.h"

namespace trex::bundle {
namespace {

constexpr std::uint64_t kAttributeBytes = 4;  // a vertex, of each attribute in an HCCMesh

/// One attribute over all meshes that are placed.
struct Attribute {
  std::uint64_t vertices = 0;       ///< that have it
  std::uint64_t savedVertices = 0;  ///< that do without
  void count(bool stored, std::uint64_t n) { (stored ? vertices : savedVertices) += n; }
  Requirement describe(const char* name, const char* why, const char* whyNot) const {
    const bool required = vertices > 0;
    return {name, required,
            required ? fmt::format("{} on {} vertices", why, vertices) : std::string(whyNot),
            savedVertices * kAttributeBytes};
  }
};

}  // namespace

std::vector<Requirement> requirementsOf(const Scene& scene, bool voxels) {
  std::set<int> meshes;
  for (const Instance& i : scene.instances) meshes.insert(i.mesh);
  Attribute normals, texCoords, secondTexCoords, colors;
  bool transparent = false, scatters = false;
  for (const int m : meshes) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(m)];
    const Material& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    const std::uint64_t n = mesh.positions.size();
    normals.count(!mesh.normals.empty(), n);
    texCoords.count(!mesh.texCoords.empty() && readsTexCoords(material), n);
    secondTexCoords.count(!mesh.secondTexCoords.empty() && readsSecondTexCoords(material), n);
    colors.count(!mesh.colors.empty(), n);
    transparent |= material.alphaMode != AlphaMode::kOpaque || material.transmission > 0.0f;
    scatters |= !material.unlit;
  }
  const bool caustics = CausticMaps::needed(scene);
  std::uint64_t mediaBytes = 0;
  for (const Medium& m : scene.media) mediaBytes += m.grid->bytes();
  const bool lit = hasLight(scene), photons = lit && scatters && voxels;
  Requirement forTextures =
      texCoords.describe("texture coordinates", "textures are read", "nothing is textured");
  if (secondTexCoords.vertices > 0) {
    forTextures.reason += fmt::format(", {} of them with a second set", secondTexCoords.vertices);
  }
  return {normals.describe("normals", "smooth shading", "all faces are flat"),
          forTextures,
          colors.describe("vertex colours", "colours are given", "no mesh has any"),
          {"textures", !scene.images.empty(),
           scene.images.empty() ? "no material has any"
                                : fmt::format("{} images", scene.images.size())},
          {"transparency", transparent,
           transparent ? "a material lets light pass" : "all materials are opaque"},
          {"environment", scene.environment.present(),
           scene.environment.present() ? "it shines" : "there is none"},
          {"media", !scene.media.empty(),
           scene.media.empty() ? "there is no volume"
                               : fmt::format("{} volumes, {} of voxels", scene.media.size(),
                                             formatBytes(mediaBytes))},
          {"voxels", lit && voxels,
           !voxels ? "left out on request"
           : lit   ? "light is cached in them"
                   : "nothing shines"},
          {"photons", photons,
           photons   ? "light bounces"
           : !voxels ? "there are no voxels"
                     : "no light can bounce"},
          {"caustics", caustics,
           caustics ? "mirrors or glass bend the light of suns, points or spots"
                    : "no mirror or clear glass meets a sun, point or spot"}};
}

}  // namespace trex::bundle
