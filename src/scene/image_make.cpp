#include "src/scene/image_make.h"

#include <algorithm>

#include "src/scene/texels.h"
#include "src/scene/texture.h"

namespace trex::detail {
namespace {

std::uint8_t toByte(float value) {
  return static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
}

/// Values of a texel of an image of `width` times `height`, as the file has them.
vec4 valueAt(const Image& image, int x, int y, int width, int height) {
  const vec2 uv((static_cast<float>(x) + 0.5f) / static_cast<float>(width),
                (static_cast<float>(y) + 0.5f) / static_cast<float>(height));
  return sampleTexture(image, {}, uv, false);
}

/// As large as the image with the most texels; any but one may be null.
Image blank(std::initializer_list<const Image*> sources, int channels) {
  const auto texels = [](const Image* i) {
    return i != nullptr ? std::size_t(i->width) * i->height : std::size_t{0};
  };
  const Image* largest =
      *std::max_element(sources.begin(), sources.end(),
                        [&](const Image* a, const Image* b) { return texels(a) < texels(b); });
  Image image;
  image.width = largest->width;
  image.height = largest->height;
  image.channels = channels;
  image.bytes.resize(texels(largest) * channels);
  return image;
}

/// Calls texel(x, y) for the values of all texels.
template <typename Texel>
void fill(Image& image, Texel texel) {
  std::size_t at = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const vec4 value = texel(x, y);
      for (int c = 0; c < image.channels; ++c) image.bytes[at++] = toByte(value[c]);
    }
  }
}

}  // namespace

Image withOpacity(const Image* color, const Image& opacity) {
  // Deep images hold linear values; bytes are encoded.
  const bool linear = color != nullptr && isDeep(*color);
  const bool hasAlpha = opacity.channels == 2 || opacity.channels == 4;
  Image image = blank({color, &opacity}, 4);
  const int width = image.width, height = image.height;
  fill(image, [&](int x, int y) {
    vec4 value(1.0f);
    if (color != nullptr) value = valueAt(*color, x, y, width, height);
    for (int c = 0; linear && c < 3; ++c) value[c] = encodeSrgb(std::clamp(value[c], 0.0f, 1.0f));
    const vec4 mask = valueAt(opacity, x, y, width, height);
    value.w = hasAlpha ? mask.w : luminance(vec3(mask));
    return value;
  });
  return image;
}

Image roughnessAndMetallic(const Image* roughness, const Image* metallic) {
  Image image = blank({roughness, metallic}, 3);
  const int width = image.width, height = image.height;
  const auto red = [&](const Image* i, int x, int y) {
    return i != nullptr ? valueAt(*i, x, y, width, height).x : 1.0f;
  };
  fill(image,
       [&](int x, int y) { return vec4(1.0f, red(roughness, x, y), red(metallic, x, y), 1.0f); });
  return image;
}

Image roughnessOfGlossiness(const Image& glossy, float factor) {
  Image one;
  one.width = one.height = 1;
  one.channels = 3;
  one.bytes.resize(3);
  const bool varies = glossy.width > 0 && (glossy.channels == 2 || glossy.channels == 4);
  Image image = varies ? blank({&glossy}, 3) : one;
  const int width = image.width, height = image.height;
  fill(image, [&](int x, int y) {
    const float alpha = varies ? valueAt(glossy, x, y, width, height).w : 1.0f;
    return vec4(1.0f, 1.0f - factor * alpha, 1.0f, 1.0f);
  });
  return image;
}

bool looksLikeNormals(const Image& image) {
  if (image.channels < 3) return false;
  const vec4 mean = textureMean(image, false);
  return std::abs(mean.x - 0.5f) < 0.15f && std::abs(mean.y - 0.5f) < 0.15f && mean.z > 0.7f;
}

Image normalsOfHeights(const Image& heights, float strength) {
  Image image = blank({&heights}, 3);
  const int width = image.width, height = image.height;
  const auto at = [&](int x, int y) {
    return luminance(
        vec3(valueAt(heights, (x + width) % width, (y + height) % height, width, height)));
  };
  fill(image, [&](int x, int y) {
    // Rows go down, the tangent space's second axis up.
    const float alongX = 0.5f * strength * (at(x + 1, y) - at(x - 1, y));
    const float alongY = 0.5f * strength * (at(x, y - 1) - at(x, y + 1));
    const vec3 normal = glm::normalize(vec3(-alongX, -alongY, 1.0f));
    return vec4(normal * 0.5f + 0.5f, 1.0f);
  });
  return image;
}

}  // namespace trex::detail
