#include "src/session/voxel_source.h"

#include <algorithm>

#include "src/core/error.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

vec3 textured(const Scene& scene, const Texture& texture, vec2 uv) {
  if (!texture.present()) return vec3(1.0f);
  return vec3(
      sampleTexture(scene.images[static_cast<std::size_t>(texture.image)], texture, uv, true));
}

}  // namespace

bool passesLight(const Material& m) {
  const bool clear = m.transmission * (1.0f - m.metallic) > 0.5f && m.roughness < 0.2f;
  const bool faint = m.alphaMode == AlphaMode::kBlend && m.baseColor.w < 0.5f;
  return clear || faint;
}

VoxelSource::VoxelSource(const Scene& scene, const dvec3& renderOrigin) : scene_(scene) {
  firsts_.push_back(0);
  for (const Instance& instance : scene.instances) {
    const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
    if (passesLight(scene.materials[static_cast<std::size_t>(mesh.material)])) continue;
    dmat4 toRender = instance.transform;
    const dvec3 origin(instance.transform * glm::dvec4(mesh.origin, 1.0));
    toRender[3] = glm::dvec4(origin - renderOrigin, 1.0);
    placed_.push_back({&mesh, toRender, glm::determinant(glm::dmat3(toRender)) < 0.0});
    firsts_.push_back(firsts_.back() + mesh.triangles.size());
  }
  if (count() > 0xffffffffu) {
    fail(ExitCode::kMemoryOrDevice, "{}: {} placed triangles, voxels are built from at most 2^32",
         scene.source, count());
  }
}

void VoxelSource::get(std::uint64_t i, asvo::Triangle& triangle) const {
  const auto after = std::upper_bound(firsts_.begin() + 1, firsts_.end() - 1, i);
  const auto which = static_cast<std::size_t>(after - firsts_.begin()) - 1;
  const Placed& placed = placed_[which];
  const glm::uvec3 t = placed.mesh->triangles[i - firsts_[which]];
  for (int k = 0; k < 3; ++k) {
    const vec3 p = placed.mesh->positions[t[k]];
    triangle.position[k] = vec3(placed.toRender * glm::dvec4(dvec3(p), 1.0));
  }
  if (placed.mirrored) std::swap(triangle.position[1], triangle.position[2]);
  triangle.material = static_cast<std::uint32_t>(placed.mesh->material);
  triangle.shadeKey = static_cast<std::uint32_t>(i);
}

asvo::Shade VoxelSource::shade(const asvo::Triangle& triangle, float u, float v) const {
  const auto after = std::upper_bound(firsts_.begin() + 1, firsts_.end() - 1, triangle.shadeKey);
  const auto which = static_cast<std::size_t>(after - firsts_.begin()) - 1;
  const Placed& placed = placed_[which];
  glm::uvec3 t = placed.mesh->triangles[triangle.shadeKey - firsts_[which]];
  if (placed.mirrored) std::swap(t.y, t.z);
  const auto mix = [&](const auto& values) {
    return (1.0f - u - v) * values(t.x) + u * values(t.y) + v * values(t.z);
  };
  vec2 uv(0.0f);
  vec3 color(1.0f);
  if (!placed.mesh->texCoords.empty()) {
    uv = mix([&](std::uint32_t k) { return placed.mesh->texCoords[k]; });
  }
  if (!placed.mesh->colors.empty()) {
    color = mix([&](std::uint32_t k) { return vec3(placed.mesh->colors[k]) / 255.0f; });
  }
  return shadeOf(scene_, triangle.material, uv, color);
}

asvo::Shade shadeOf(const Scene& scene, std::uint32_t material, vec2 uv, const vec3& vertexColor) {
  const Material& m = scene.materials[material];
  const vec3 color = vec3(m.baseColor) * vertexColor * textured(scene, m.baseColorTexture, uv);
  // The broad part of the specular lobe counts as diffuse, as Bsdf::cachedAlbedo() does.
  const float f0 = (m.ior - 1.0f) * (m.ior - 1.0f) / ((m.ior + 1.0f) * (m.ior + 1.0f));
  const vec3 gloss = m.specular * (f0 * m.specularColor + (1.0f - f0) / 21.0f);
  const vec3 diffuse = color * (1.0f - m.transmission);
  asvo::Shade out;
  out.albedo = glm::min((diffuse * (vec3(1.0f) - gloss) + gloss) * (1.0f - m.metallic), vec3(1.0f));
  if (m.unlit) out.albedo = vec3(0.0f);
  out.emission = m.emission * textured(scene, m.emissiveTexture, uv);
  out.emitsBack = m.doubleSided;
  return out;
}

std::vector<shaderio::PhotonMaterial> photonMaterials(const Scene& scene) {
  std::vector<shaderio::PhotonMaterial> out;
  for (const Material& m : scene.materials) {
    vec3 color(m.baseColor);
    if (m.baseColorTexture.present()) {
      color *=
          vec3(textureMean(scene.images[static_cast<std::size_t>(m.baseColorTexture.image)], true));
    }
    const glm::uvec3 bytes(glm::clamp(color, 0.0f, 1.0f) * 255.0f + 0.5f);
    out.push_back({m.unlit ? 0.0f : m.metallic, m.roughness,
                   bytes.x | (bytes.y << 8) | (bytes.z << 16) | 0xff000000u, 0u});
  }
  return out;
}

}  // namespace trex
