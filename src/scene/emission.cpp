#include "src/scene/emission.h"

#include <algorithm>

#include "src/scene/texture.h"

namespace trex {
namespace {

vec4 read(const std::vector<Image>& images, const Texture& texture, vec2 uv) {
  if (!texture.present()) return vec4(1.0f);
  return sampleTexture(images[static_cast<std::size_t>(texture.image)], texture, uv, true);
}

}  // namespace

vec3 emissionAt(const Material& material, const std::vector<Image>& images, vec2 uv) {
  return material.emission * vec3(read(images, material.emissiveTexture, uv));
}

float coverageOf(const Material& material, float alpha) {
  switch (material.alphaMode) {
    case AlphaMode::kBlend:
      return std::clamp(alpha, 0.0f, 1.0f);
    case AlphaMode::kMask:
      return alpha >= material.alphaCutoff ? 1.0f : 0.0f;
    case AlphaMode::kOpaque:
      break;
  }
  return 1.0f;
}

float coverageAt(const Material& material, const std::vector<Image>& images, vec2 uv,
                 float vertexAlpha) {
  if (material.alphaMode == AlphaMode::kOpaque) return 1.0f;
  const float texture = read(images, material.baseColorTexture, uv).w;
  return coverageOf(material, material.baseColor.w * vertexAlpha * texture);
}

}  // namespace trex
