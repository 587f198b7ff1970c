// Images as packed tiles: how texels lie in bundles, and in the temporary file of a texture cache.
// src/bundle/FORMAT.md, "Tiles of images", is the authority.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "src/scene/scene.h"

namespace trex {

/// Texels across a tile, and bytes of one in memory, at most. Larger ones pack a little better, but
/// rays that come from anywhere read one texel of each: 4 KiB cost them a third of 16.
inline constexpr std::uint32_t kTileWidth = 32, kTileBytes = 4096;

/// A tile's texels in memory, row after row. Words: so that others may read them meanwhile.
using TileWords = std::array<std::uint32_t, kTileBytes / 4>;

/// How an image is cut.
struct TileGrid {
  TileGrid(const Image& size, TexelKind kind);
  std::uint64_t count() const { return std::uint64_t{across} * down; }
  std::uint32_t bytes() const { return texel * kTileWidth * rows; }  ///< of a tile

  TexelKind kind;
  std::uint32_t texel;         ///< bytes of one
  std::uint32_t rows;          ///< of a tile
  std::uint32_t across, down;  ///< tiles of the image
};

/// Where packed texels lie. Thread safe.
class TexelFile {
 public:
  virtual ~TexelFile() = default;
  /// Throws Error that names the file and the place.
  virtual void read(std::uint64_t offset, std::span<std::byte> out) const = 0;
  /// May fetch a range ahead of its use; returns at once.
  virtual void readAhead(std::uint64_t offset, std::uint64_t bytes) const = 0;
  /// The bytes as a map that memory is not short of, if the file has one; else null.
  virtual std::shared_ptr<const std::span<const std::byte>> map(std::uint64_t,
                                                                std::uint64_t) const {
    return nullptr;
  }
  /// Throws Error for what is wrong at a place.
  [[noreturn]] virtual void bad(std::uint64_t offset, const std::string& what) const = 0;
};

/// There may be many millions of them.
struct PackedTile {
  std::uint64_t offset : 51 = 0;  ///< in the file
  std::uint64_t bytes : 13 = 0;   ///< 1 to kTileBytes
  std::uint64_t hash = 0;         ///< XXH3-64 of the packed bytes
};
static_assert(kTileBytes < 1u << 13 && sizeof(PackedTile) == 16);

/// What lies before an image's tiles.
struct TileTable {
  vec4 mean[2];  ///< of all texels, linear; bytes read as linear, as sRGB
  std::vector<PackedTile> tiles;
};

/// All of an image that is whole in memory; equal images give equal bytes. Throws Error(kFailed) if
/// zstd does. Uses the calling oneTBB arena.
std::vector<std::byte> packTiles(const Image& image);

/// Reads and checks the table of an image at `offset` of a file, that takes `bytes` there.
TileTable readTileTable(const TexelFile& file, std::uint64_t offset, std::uint64_t bytes,
                        const TileGrid& grid);

/// Reads a tile, checks and unpacks it.
void readTile(const TexelFile& file, const PackedTile& tile, const TileGrid& grid, TileWords& out);

}  // namespace trex
