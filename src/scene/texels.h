// Texels as they lie in memory: their kinds and sizes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "src/scene/scene.h"

namespace trex {

/// The values of an image that is whole in memory; empty of one in tiles.
inline std::span<const std::byte> wholeTexels(const Image& image) {
  if (!image.bytes.empty()) return std::as_bytes(std::span(image.bytes));
  if (!image.words.empty()) return std::as_bytes(std::span(image.words));
  return std::as_bytes(std::span(image.floats));
}

/// An image's texels are there, whole or in tiles.
inline bool hasTexels(const Image& image) {
  return image.width > 0 && image.height > 0 && (image.paged || !wholeTexels(image).empty());
}

TexelKind kindOfTiles(const PagedTexels& paged);
inline TexelKind texelKind(const Image& image) {
  if (!image.bytes.empty()) return TexelKind::kByte;
  if (!image.words.empty()) return image.wordKind;
  if (!image.floats.empty()) return TexelKind::kFloat;
  return image.paged ? kindOfTiles(*image.paged) : TexelKind::kByte;
}
/// Wider than 8 bits: what it holds is said by its kind, not by who reads it.
inline bool isDeep(const Image& image) { return texelKind(image) != TexelKind::kByte; }

/// Bytes of one texel, and of all of an image, as it lies in memory.
std::uint32_t texelBytes(TexelKind kind, int channels);
std::uint64_t texelBytes(const Image& image, TexelKind kind);

/// Makes room for all values of a kind, and gives it. Not of an image in tiles.
std::span<std::byte> makeTexels(Image& image, TexelKind kind);

/// Of a 16-bit float.
constexpr bool isFiniteHalf(std::uint16_t bits) { return (bits & 0x7c00u) != 0x7c00u; }

/// Whether floats and halves among the values are finite.
bool areFinite(std::span<const std::byte> values, TexelKind kind);

}  // namespace trex
