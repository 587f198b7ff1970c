#include "src/scene/emission.h"

#include <algorithm>

#include "src/scene/texture.h"

namespace trex {

vec3 emissionAt(const Material& material, const std::vector<Image>& images, const TexCoords& uv) {
  return material.emission * vec3(readTexture(images, material.emissiveTexture, uv, true));
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

float coverageAt(const Material& material, const std::vector<Image>& images, const TexCoords& uv,
                 float vertexAlpha) {
  if (material.alphaMode == AlphaMode::kOpaque) return 1.0f;
  const float texture = readTexture(images, material.baseColorTexture, uv, true).w;
  return coverageOf(material, material.baseColor.w * vertexAlpha * texture);
}

}  // namespace trex
