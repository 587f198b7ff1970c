#include "src/session/voxel_source.h"

#include "src/core/error.h"
#include "src/crays/finish.h"
#include "src/scene/emission.h"
#include "src/scene/look.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

/// Of light from everywhere, without the finish's textures.
vec3 underFinish(const Finish& finish, const vec3& bare) {
  constexpr float kCoat = 0.092f;  // of index 1.5, seen from everywhere
  constexpr float kMiddle = 0.5f;  // cosine
  const float coat = kCoat * finish.clearcoat;
  const float alpha = std::max(finish.sheenRoughness * finish.sheenRoughness, kLeastSheenAlpha);
  const vec3 fibres =
      finish.sheens() ? finish.sheenColor * sheenAlbedo(kMiddle, alpha) : vec3(0.0f);
  return (bare * (1.0f - maxComponent(fibres)) + fibres) * (1.0f - coat) + coat;
}

}  // namespace

vec3 voxelAlbedo(const Material& m, const vec3& baseColor) {
  if (m.unlit) return vec3(0.0f);
  // The broad part of the specular lobe counts as diffuse.
  const float f0 = (m.ior - 1.0f) * (m.ior - 1.0f) / ((m.ior + 1.0f) * (m.ior + 1.0f));
  const vec3 gloss = m.specular * (f0 * m.specularColor + (1.0f - f0) / 21.0f);
  const vec3 diffuse = baseColor * (1.0f - m.transmission);
  const vec3 bare = (diffuse * (vec3(1.0f) - gloss) + gloss) * (1.0f - m.metallic);
  return glm::min(m.finish.present() ? underFinish(m.finish, bare) : bare, vec3(1.0f));
}

bool sendsByDirection(const Material& m) {
  constexpr float kLeast = 0.1f;  // Bsdf::kMostSharp
  return !m.unlit && (m.metallic > kLeast || m.transmission > kLeast);
}

vec3 meanColor(const std::vector<Image>& images, const Texture& texture) {
  if (!texture.present()) return vec3(1.0f);
  return vec3(textureMean(images[static_cast<std::size_t>(texture.image)], true));
}

asvo::Shade voxelShade(const Material& m, const std::vector<Image>& images, const TexCoords& uv,
                       const vec4& vertexColor) {
  asvo::Shade out;
  out.albedo = voxelAlbedo(
      m, vec3(m.baseColor * vertexColor) * vec3(readTexture(images, m.baseColorTexture, uv, true)));
  out.emission = emissionAt(m, images, uv) * coverageAt(m, images, uv, vertexColor.w);
  out.emitsBack = m.doubleSided;
  out.byDirection = sendsByDirection(m);
  return out;
}

std::vector<std::optional<asvo::Shade>> plainShades(const std::vector<Material>& materials,
                                                    const std::vector<Image>& images) {
  std::vector<std::optional<asvo::Shade>> out(materials.size());
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const Material& m = materials[i];
    if (m.baseColorTexture.present() || m.emissiveTexture.present()) continue;
    out[i] = voxelShade(m, images, TexCoords{}, vec4(1.0f));
  }
  return out;
}

VoxelSource::VoxelSource(const Scene& scene, std::vector<Material> materials,
                         const dvec3& renderOrigin)
    : scene_(scene),
      materials_(std::move(materials)),
      plain_(plainShades(materials_, scene.images)) {
  for (const Instance& instance : scene.instances) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    if (passesLight(materials_[static_cast<std::size_t>(mesh.material)])) continue;
    const glm::dmat3 linear(instance.transform);
    const dvec3 origin(instance.transform * glm::dvec4(mesh.origin, 1.0));
    placed_.push_back({&mesh, linear, origin - renderOrigin, glm::determinant(linear) < 0.0});
    runs_.add(mesh.triangles.size());
  }
  runs_.finish();
  if (count() > 0xffffffffu) {
    fail(ExitCode::kMemoryOrDevice, "{}: {} placed triangles, voxels are built from at most 2^32",
         scene.source, count());
  }
}

void VoxelSource::get(std::uint64_t i, asvo::Triangle& triangle) const {
  std::uint32_t number = 0;
  const Placed& placed = placed_[runs_.find(i, number)];
  const glm::uvec3 t = placed.mesh->triangles[number];
  for (int k = 0; k < 3; ++k) {
    const vec3 p = placed.mesh->positions[t[k]];
    triangle.position[k] = vec3(placed.linear * dvec3(p) + placed.origin);
  }
  if (placed.mirrored) std::swap(triangle.position[1], triangle.position[2]);
  triangle.material = static_cast<std::uint32_t>(placed.mesh->material);
  triangle.shadeKey = static_cast<std::uint32_t>(i);
}

bool VoxelSource::uniform(const asvo::Triangle& triangle) const {
  if (!plain_[triangle.material]) return false;
  std::uint32_t number = 0;
  return placed_[runs_.find(triangle.shadeKey, number)].mesh->colors.empty();
}

asvo::Shade VoxelSource::shade(const asvo::Triangle& triangle, float u, float v) const {
  const Material& m = materials_[triangle.material];
  std::uint32_t number = 0;
  const Placed& placed = placed_[runs_.find(triangle.shadeKey, number)];
  if (plain_[triangle.material] && placed.mesh->colors.empty()) return *plain_[triangle.material];
  glm::uvec3 t = placed.mesh->triangles[number];
  if (placed.mirrored) std::swap(t.y, t.z);
  const auto mix = [&](const auto& values) {
    return (1.0f - u - v) * values(t.x) + u * values(t.y) + v * values(t.z);
  };
  TexCoords uv{};
  vec4 color(1.0f);
  if (!placed.mesh->texCoords.empty()) {
    uv[0] = mix([&](std::uint32_t k) { return placed.mesh->texCoords[k]; });
  }
  if (!placed.mesh->secondTexCoords.empty()) {
    uv[1] = mix([&](std::uint32_t k) { return placed.mesh->secondTexCoords[k]; });
  }
  if (!placed.mesh->colors.empty()) {
    color = mix([&](std::uint32_t k) { return unpackVertexColor(placed.mesh->colors[k]); });
  }
  return voxelShade(m, scene_.images, uv, color);
}

std::vector<shaderio::PhotonMaterial> photonMaterials(const std::vector<Material>& materials,
                                                      const std::vector<Image>& images) {
  std::vector<shaderio::PhotonMaterial> out;
  for (const Material& m : materials) {
    const vec3 color = vec3(m.baseColor) * meanColor(images, m.baseColorTexture);
    const glm::uvec3 bytes(glm::clamp(color, 0.0f, 1.0f) * 255.0f + 0.5f);
    out.push_back({m.unlit ? 0.0f : m.metallic, m.roughness,
                   bytes.x | (bytes.y << 8) | (bytes.z << 16) | 0xff000000u, 0u});
  }
  return out;
}

}  // namespace trex
