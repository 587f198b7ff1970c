#include "src/scene/texture.h"

#include <array>
#include <glm/gtc/packing.hpp>
#include <type_traits>
#include <vector>

#include "src/scene/texels.h"
#include "src/scene/texture_cache.h"

namespace trex {
namespace {

struct ByteTables {
  std::array<float, 256> srgb, unorm;
  ByteTables() {
    for (int i = 0; i < 256; ++i) {
      unorm[i] = static_cast<float>(i) / 255.0f;
      srgb[i] = decodeSrgb(unorm[i]);
    }
  }
};
const ByteTables kByteTables;

/// All values of 16 bits. Made when an image has some.
struct WordTables {
  static constexpr std::size_t kCount = 65536;
  std::vector<float> unorm, srgb, half;
  WordTables() : unorm(kCount), srgb(kCount), half(kCount) {
    for (std::size_t i = 0; i < kCount; ++i) {
      unorm[i] = static_cast<float>(i) * (1.0f / 65535.0f);  // as OpenImageIO has it
      srgb[i] = decodeSrgb(unorm[i]);
      half[i] = glm::unpackHalf1x16(static_cast<std::uint16_t>(i));
    }
  }
};
const WordTables& wordTables() {
  static const WordTables tables;
  return tables;
}

/// Values as linear floats: by a table. Floats are taken as they are.
struct Decoder {
  TexelKind kind;
  const float *color = nullptr, *alpha = nullptr;

  Decoder(TexelKind of, bool srgb) : kind(of) {
    switch (kind) {
      case TexelKind::kByte:
        color = srgb ? kByteTables.srgb.data() : kByteTables.unorm.data();
        alpha = kByteTables.unorm.data();
        break;
      case TexelKind::kWord:
        color = alpha = wordTables().unorm.data();
        break;
      case TexelKind::kSrgbWord:
        color = wordTables().srgb.data();
        alpha = wordTables().unorm.data();
        break;
      case TexelKind::kHalf:
        color = alpha = wordTables().half.data();
        break;
      case TexelKind::kFloat:
        break;
    }
  }
};

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

/// Texel `index` as RGBA; T is looked up in a table, or float, taken as it is.
template <int kChannels, typename T>
vec4 texel(const T* texels, std::size_t index, const Decoder& decoder) {
  const T* p = texels + index * kChannels;
  const auto color = [&](int c) {
    if constexpr (std::is_same_v<T, float>) {
      return p[c];
    } else {
      return decoder.color[p[c]];
    }
  };
  const auto alpha = [&](int c) {
    if constexpr (std::is_same_v<T, float>) {
      return p[c];
    } else {
      return decoder.alpha[p[c]];
    }
  };
  if constexpr (kChannels == 1) return vec4(vec3(color(0)), 1.0f);
  if constexpr (kChannels == 2) return vec4(vec3(color(0)), alpha(1));
  const vec3 rgb(color(0), color(1), color(2));
  if constexpr (kChannels == 3) return vec4(rgb, 1.0f);
  return vec4(rgb, alpha(3));
}

/// Calls function(texels, channel count as a type) for values of this kind at `first`.
template <typename Function>
vec4 withTexels(TexelKind kind, int channels, const std::byte* first, Function function) {
  const auto byChannels = [&](const auto* texels) {
    switch (channels) {
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
  switch (kind) {
    case TexelKind::kByte:
      return byChannels(reinterpret_cast<const std::uint8_t*>(first));
    case TexelKind::kFloat:
      return byChannels(reinterpret_cast<const float*>(first));
    default:
      return byChannels(reinterpret_cast<const std::uint16_t*>(first));
  }
}

/// Where a sample reads, and how its texels are mixed.
struct Taps {
  Tap x, y;
  Taps(const Image& image, const Texture& texture, vec2 uv) {
    uv = transformUv(texture, uv);
    x = tap(uv.x, image.width, texture.wrapS, texture.nearest);
    y = tap(uv.y, image.height, texture.wrapT, texture.nearest);
  }
  /// Of the upper two texels and the lower two.
  vec4 mix(const vec4& a, const vec4& b, const vec4& c, const vec4& d) const {
    const vec4 top = a + (b - a) * x.weight, bottom = c + (d - c) * x.weight;
    return top + (bottom - top) * y.weight;
  }
};

vec4 samplePaged(const PagedTexels& paged, const Taps& taps, bool srgb) {
  PagedTexels::Four four;
  paged.read({taps.x.first, taps.x.second}, {taps.y.first, taps.y.second}, four);
  const Decoder decoder(paged.kind(), srgb);
  return withTexels(paged.kind(), paged.channels(), four.texels, [&](const auto* p, auto channels) {
    constexpr int kChannels = decltype(channels)::value;
    constexpr std::size_t kStep = PagedTexels::Four::kStride / sizeof(*p);
    const auto at = [&](std::size_t i) { return texel<kChannels>(p + i * kStep, 0, decoder); };
    return taps.mix(at(0), at(1), at(2), at(3));
  });
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
  const Taps taps(image, texture, uv);
  if (image.paged) return samplePaged(*image.paged, taps, srgb);
  const Decoder decoder(texelKind(image), srgb);
  const std::size_t upper = std::size_t(taps.y.first) * image.width;
  const std::size_t lower = std::size_t(taps.y.second) * image.width;
  return withTexels(decoder.kind, image.channels, wholeTexels(image).data(),
                    [&](const auto* texels, auto channels) {
                      constexpr int kChannels = decltype(channels)::value;
                      const auto at = [&](std::size_t i) {
                        return texel<kChannels>(texels, i, decoder);
                      };
                      return taps.mix(at(upper + taps.x.first), at(upper + taps.x.second),
                                      at(lower + taps.x.first), at(lower + taps.x.second));
                    });
}

void prefetchTexture(const Image& image, const Texture& texture, vec2 uv) {
  if (!hasTexels(image)) return;
  const Taps taps(image, texture, uv);
  if (image.paged) return image.paged->ask(taps.x.first, {taps.y.first, taps.y.second});
  const std::byte* texels = wholeTexels(image).data();
  const std::size_t bytes = texelBytes(texelKind(image), image.channels);
  for (const int row : {taps.y.first, taps.y.second}) {
    __builtin_prefetch(texels + (std::size_t(row) * image.width + taps.x.first) * bytes);
  }
}

vec4 textureMean(const Image& image, bool srgb) {
  if (!hasTexels(image)) return vec4(1.0f);
  if (image.paged) return image.paged->mean(srgb);
  const std::size_t count = std::size_t(image.width) * image.height;
  const Decoder decoder(texelKind(image), srgb);
  return withTexels(decoder.kind, image.channels, wholeTexels(image).data(),
                    [&](const auto* texels, auto channels) {
                      glm::dvec4 sum(0.0);
                      for (std::size_t i = 0; i < count; ++i) {
                        sum += glm::dvec4(texel<decltype(channels)::value>(texels, i, decoder));
                      }
                      return vec4(sum / static_cast<double>(count));
                    });
}

}  // namespace trex
