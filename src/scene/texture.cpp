#include "src/scene/texture.h"

#include <array>
#include <type_traits>

#include "src/scene/import_detail.h"

namespace trex {
namespace {

struct Tables {
  std::array<float, 256> srgb, unorm;
  Tables() {
    for (int i = 0; i < 256; ++i) {
      unorm[i] = static_cast<float>(i) / 255.0f;
      srgb[i] = decodeSrgb(unorm[i]);
    }
  }
};
const Tables kTables;

/// Two neighbouring texels along one axis and the weight of the second.
struct Tap {
  int first, second;
  float weight;
};

int wrapped(int i, int size, Texture::Wrap wrap) {
  switch (wrap) {
    case Texture::Wrap::kRepeat:
      return i < 0 ? i + size : i >= size ? i - size : i;
    case Texture::Wrap::kMirror:
      return i < 0 ? -1 - i : i >= size ? 2 * size - 1 - i : i;
    case Texture::Wrap::kClamp:
      break;
  }
  return i < 0 ? 0 : i >= size ? size - 1 : i;
}

Tap tap(float coordinate, int size, Texture::Wrap wrap, bool nearest) {
  if (!std::isfinite(coordinate)) coordinate = 0.0f;
  float c = coordinate;
  if (wrap == Texture::Wrap::kRepeat) {
    c -= std::floor(c);
  } else if (wrap == Texture::Wrap::kMirror) {
    c -= 2.0f * std::floor(0.5f * c);
    if (c > 1.0f) c = 2.0f - c;
  } else {
    c = c < 0.0f ? 0.0f : c > 1.0f ? 1.0f : c;
  }
  const float x = c * static_cast<float>(size) - 0.5f;
  const float base = std::floor(x);
  const int i = static_cast<int>(base);
  if (nearest) {
    const int texel = wrapped(x - base < 0.5f ? i : i + 1, size, wrap);
    return {texel, texel, 0.0f};
  }
  return {wrapped(i, size, wrap), wrapped(i + 1, size, wrap), x - base};
}

/// Texel `index` as RGBA; T is uint8_t, looked up in a table, or float, taken as it is.
template <int kChannels, typename T>
vec4 texel(const T* texels, std::size_t index, const float* colorTable) {
  const T* p = texels + index * kChannels;
  const auto value = [p](int c, const float* table) {
    if constexpr (std::is_same_v<T, float>) {
      return p[c];
    } else {
      return table[p[c]];
    }
  };
  const float* unorm = kTables.unorm.data();
  if constexpr (kChannels == 1) return vec4(vec3(value(0, colorTable)), 1.0f);
  if constexpr (kChannels == 2) return vec4(vec3(value(0, colorTable)), value(1, unorm));
  const vec3 color(value(0, colorTable), value(1, colorTable), value(2, colorTable));
  if constexpr (kChannels == 3) return vec4(color, 1.0f);
  return vec4(color, value(3, unorm));
}

/// Calls function(texels, channel count as a type) for the kind of the image.
template <typename Function>
vec4 withTexels(const Image& image, Function function) {
  const auto byChannels = [&](const auto* texels) {
    switch (image.channels) {
      case 1:
        return function(texels, std::integral_constant<int, 1>());
      case 2:
        return function(texels, std::integral_constant<int, 2>());
      case 3:
        return function(texels, std::integral_constant<int, 3>());
      default:
        return function(texels, std::integral_constant<int, 4>());
    }
  };
  return image.bytes.empty() ? byChannels(image.floats.data()) : byChannels(image.bytes.data());
}

const float* colorTable(bool srgb) { return srgb ? kTables.srgb.data() : kTables.unorm.data(); }

bool hasTexels(const Image& image) {
  return image.width > 0 && image.height > 0 && !(image.bytes.empty() && image.floats.empty());
}

}  // namespace

vec2 transformUv(const Texture& texture, vec2 uv) {
  uv *= texture.scale;
  if (texture.rotation != 0.0f) {
    const float c = std::cos(texture.rotation), s = std::sin(texture.rotation);
    uv = vec2(c * uv.x + s * uv.y, c * uv.y - s * uv.x);
  }
  return uv + texture.offset;
}

vec4 sampleTexture(const Image& image, const Texture& texture, vec2 uv, bool srgb) {
  if (!hasTexels(image)) return vec4(1.0f);
  uv = transformUv(texture, uv);
  const Tap x = tap(uv.x, image.width, texture.wrapS, texture.nearest);
  const Tap y = tap(uv.y, image.height, texture.wrapT, texture.nearest);
  const float* table = colorTable(srgb);
  const std::size_t upper = std::size_t(y.first) * image.width;
  const std::size_t lower = std::size_t(y.second) * image.width;
  return withTexels(image, [&](const auto* texels, auto channels) {
    constexpr int kChannels = decltype(channels)::value;
    const auto at = [&](std::size_t i) { return texel<kChannels>(texels, i, table); };
    const vec4 a = at(upper + x.first), b = at(upper + x.second);
    const vec4 c = at(lower + x.first), d = at(lower + x.second);
    const vec4 top = a + (b - a) * x.weight, bottom = c + (d - c) * x.weight;
    return top + (bottom - top) * y.weight;
  });
}

void prefetchTexture(const Image& image, const Texture& texture, vec2 uv) {
  if (!hasTexels(image)) return;
  uv = transformUv(texture, uv);
  const Tap x = tap(uv.x, image.width, texture.wrapS, texture.nearest);
  const Tap y = tap(uv.y, image.height, texture.wrapT, texture.nearest);
  const auto ask = [&](int row) {
    const std::size_t first =
        (std::size_t(row) * image.width + x.first) * static_cast<std::size_t>(image.channels);
    if (image.bytes.empty()) {
      __builtin_prefetch(&image.floats[first]);
    } else {
      __builtin_prefetch(&image.bytes[first]);
    }
  };
  ask(y.first);
  ask(y.second);
}

vec4 textureMean(const Image& image, bool srgb) {
  if (!hasTexels(image)) return vec4(1.0f);
  const std::size_t count = std::size_t(image.width) * image.height;
  return withTexels(image, [&](const auto* texels, auto channels) {
    glm::dvec4 sum(0.0);
    for (std::size_t i = 0; i < count; ++i) {
      sum += glm::dvec4(texel<decltype(channels)::value>(texels, i, colorTable(srgb)));
    }
    return vec4(sum / static_cast<double>(count));
  });
}

}  // namespace trex
