#include <algorithm>

#include "src/crays/microfacet.h"
#include "src/crays/plain_lanes.h"
#include "src/scene/texture.h"

namespace trex {

PlainMaterial PlainMaterial::at(const Scene& scene, std::uint32_t number, const TexCoords& uv,
                                const vec4& vertexColor) const {
  PlainMaterial out = *this;
  if (!textured() && vertexColor == vec4(1.0f)) return out;
  const Material& m = scene.materials[number];
  const vec4 base =
      m.baseColor * vertexColor * readTexture(scene.images, m.baseColorTexture, uv, true);
  out.color = glm::clamp(vec3(base), 0.0f, 1.0f);
  if (!roughnessTexture) return out;
  const vec4 metalRough = readTexture(scene.images, m.metallicRoughnessTexture, uv, false);
  out.metallic = std::clamp(m.metallic * metalRough.z, 0.0f, 1.0f);
  const float roughness = std::clamp(m.roughness * metalRough.y, 0.0f, 1.0f);
  out.alpha = roughness * roughness;
  return out;
}

std::vector<PlainMaterial> plainMaterials(const std::vector<Material>& materials) {
  std::vector<PlainMaterial> out;
  out.reserve(materials.size());
  for (const Material& m : materials) {
    PlainMaterial& p = out.emplace_back();
    p.color = glm::clamp(vec3(m.baseColor), 0.0f, 1.0f);
    p.metallic = std::clamp(m.metallic, 0.0f, 1.0f);
    const float roughness = std::clamp(m.roughness, 0.0f, 1.0f);
    p.alpha = roughness * roughness;
    const float f0 = (m.ior - 1.0f) * (m.ior - 1.0f) / ((m.ior + 1.0f) * (m.ior + 1.0f));
    p.f0 = glm::min(f0 * m.specularColor, vec3(1.0f)) * m.specular;
    p.f90 = m.specular;
    p.colorTexture = m.baseColorTexture.present();
    p.roughnessTexture = m.metallicRoughnessTexture.present();
    p.plain = m.alphaMode == AlphaMode::kOpaque && !m.unlit && !m.emits() &&
              !(m.transmission > 0.0f) && !m.finish.present() && !m.normalTexture.present() &&
              !m.specularTexture.present() && !m.specularColorTexture.present() &&
              (p.roughnessTexture || p.alpha > kClearAlpha);
  }
  return out;
}

}  // namespace trex
