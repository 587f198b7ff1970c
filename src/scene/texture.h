// Texture look-ups. All results are linear.
#pragma once

#include "src/scene/scene.h"

namespace trex {

/// Bilinear sample of image through texture at uv, with texel centres at (i + 0.5) / size. Grey
/// images fill red, green and blue; missing alpha is 1. With srgb, 8-bit RGB texels are decoded
/// before filtering (float images are linear already). A non-finite uv reads as 0. Thread safe.
vec4 sampleTexture(const Image& image, const Texture& texture, vec2 uv, bool srgb);

/// That of the texture's own image, where its set of coordinates says; 1 if it has no image.
inline vec4 readTexture(const std::vector<Image>& images, const Texture& texture,
                        const TexCoords& uv, bool srgb) {
  if (!texture.present()) return vec4(1.0f);
  return sampleTexture(images[static_cast<std::size_t>(texture.image)], texture, uv[texture.set],
                       srgb);
}

/// Asks memory for what a bilinear sample at uv reads. Thread safe.
void prefetchTexture(const Image& image, const Texture& texture, vec2 uv);

/// Whether a surface's texture coordinates count: those of textures, and for the direction of
/// anisotropy.
inline bool readsTexCoords(const Material& m) { return m.textured() || m.finish.anisotropy > 0.0f; }

/// Whether those of set 1 count.
inline bool readsSecondTexCoords(const Material& m) {
  for (const Texture* t : m.textures()) {
    if (t->present() && t->set == 1) return true;
  }
  return false;
}

/// Mean of the texture over its image (linear), for light selection.
vec4 textureMean(const Image& image, bool srgb);

/// uv after KHR_texture_transform: offset + rotation * (scale * uv), where a positive rotation
/// turns counter-clockwise as seen with v pointing down.
vec2 transformUv(const Texture& texture, vec2 uv);

}  // namespace trex
