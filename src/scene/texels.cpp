#include "src/scene/texels.h"

#include <cmath>
#include <cstring>

#include "src/scene/texture_cache.h"

namespace trex {
namespace {

std::uint32_t valueBytes(TexelKind kind) {
  return kind == TexelKind::kByte ? 1 : kind == TexelKind::kFloat ? 4 : 2;
}

}  // namespace

TexelKind kindOfTiles(const PagedTexels& paged) { return paged.kind(); }

std::uint32_t texelBytes(TexelKind kind, int channels) {
  return static_cast<std::uint32_t>(channels) * valueBytes(kind);
}

std::uint64_t texelBytes(const Image& image, TexelKind kind) {
  return std::uint64_t(image.width) * std::uint64_t(image.height) *
         texelBytes(kind, image.channels);
}

std::span<std::byte> makeTexels(Image& image, TexelKind kind) {
  const std::size_t count =
      std::size_t(image.width) * std::size_t(image.height) * std::size_t(image.channels);
  if (kind == TexelKind::kByte) {
    image.bytes.resize(count);
    return std::as_writable_bytes(std::span(image.bytes));
  }
  if (kind == TexelKind::kFloat) {
    image.floats.resize(count);
    return std::as_writable_bytes(std::span(image.floats));
  }
  image.wordKind = kind;
  image.words.resize(count);
  return std::as_writable_bytes(std::span(image.words));
}

bool areFinite(std::span<const std::byte> values, TexelKind kind) {
  if (kind == TexelKind::kFloat) {
    for (std::size_t i = 0; i + 4 <= values.size(); i += 4) {
      float value;
      std::memcpy(&value, &values[i], 4);
      if (!std::isfinite(value)) return false;
    }
  }
  if (kind == TexelKind::kHalf) {
    for (std::size_t i = 0; i + 2 <= values.size(); i += 2) {
      std::uint16_t value;
      std::memcpy(&value, &values[i], 2);
      if (!isFiniteHalf(value)) return false;
    }
  }
  return true;
}

}  // namespace trex
