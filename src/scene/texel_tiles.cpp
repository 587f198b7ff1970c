#include "src/scene/texel_tiles.h"

#define XXH_INLINE_ALL
#include <tbb/parallel_for.h>
#include <xxhash.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <memory>

#include "src/core/error.h"
#include "src/scene/texels.h"
#include "src/scene/texture.h"

namespace trex {
namespace {

constexpr int kLevel = 3;  // zstd; higher ones gain a few percent and cost seconds
constexpr std::size_t kHeadBytes = 40, kEntryBytes = 16;

std::uint64_t hashOf(std::span<const std::byte> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

template <typename T>
T valueAt(std::span<const std::byte> bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, &bytes[offset], sizeof(T));
  return value;
}

template <typename T>
void put(std::vector<std::byte>& bytes, std::size_t offset, const T& value) {
  std::memcpy(&bytes[offset], &value, sizeof(T));
}

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

/// The texels of a tile; what lies beyond the image is 0.
void cut(const Image& image, const TileGrid& grid, std::uint32_t column, std::uint32_t row,
         std::span<std::byte> out) {
  const std::span<const std::byte> all = wholeTexels(image);
  const std::size_t x = std::size_t{column} * kTileWidth, y = std::size_t{row} * grid.rows;
  const auto width = static_cast<std::size_t>(image.width);
  const std::size_t count = std::min<std::size_t>(kTileWidth, width - x);
  const std::size_t rows = std::min<std::size_t>(grid.rows, std::size_t(image.height) - y);
  std::fill(out.begin(), out.end(), std::byte{0});
  for (std::size_t i = 0; i < rows; ++i) {
    std::memcpy(&out[i * kTileWidth * grid.texel], &all[((y + i) * width + x) * grid.texel],
                count * grid.texel);
  }
}

/// Each row becomes its difference to the one above, byte by byte: a third less when packed.
void takeDifferences(std::span<std::byte> texels, std::size_t row) {
  for (std::size_t i = texels.size(); i-- > row;) {
    texels[i] = static_cast<std::byte>(std::to_integer<unsigned>(texels[i]) -
                                       std::to_integer<unsigned>(texels[i - row]));
  }
}

void addDifferences(std::span<std::byte> texels, std::size_t row) {
  auto* const at = reinterpret_cast<std::uint8_t*>(texels.data());
  for (std::size_t start = row; start < texels.size(); start += row) {
    std::uint8_t* const below = at + start;
    const std::uint8_t* const above = below - row;
    for (std::size_t i = 0; i < row; ++i) below[i] = static_cast<std::uint8_t>(below[i] + above[i]);
  }
}

/// The tiles of a row; their entries go into the table.
std::vector<std::byte> packRow(const Image& image, const TileGrid& grid, std::uint32_t row,
                               std::vector<std::byte>& table) {
  const std::unique_ptr<ZSTD_CCtx, FreeContext> zstd(ZSTD_createCCtx());
  if (!zstd) throw std::bad_alloc();
  std::vector<std::byte> out, plain(grid.bytes()), packed(ZSTD_compressBound(grid.bytes()));
  std::size_t entry = kHeadBytes + std::size_t{row} * grid.across * kEntryBytes;
  for (std::uint32_t column = 0; column < grid.across; ++column, entry += kEntryBytes) {
    cut(image, grid, column, row, plain);
    takeDifferences(plain, kTileWidth * grid.texel);
    const std::size_t size = ZSTD_compressCCtx(zstd.get(), packed.data(), packed.size(),
                                               plain.data(), plain.size(), kLevel);
    if (ZSTD_isError(size)) {
      fail(ExitCode::kFailed, "{}: can't be compressed: {}", image.name, ZSTD_getErrorName(size));
    }
    const auto kept = size < plain.size() ? std::span<const std::byte>(packed).first(size)
                                          : std::span<const std::byte>(plain);
    put(table, entry, hashOf(kept));
    put(table, entry + 8, static_cast<std::uint32_t>(kept.size()));
    out.insert(out.end(), kept.begin(), kept.end());
  }
  return out;
}

}  // namespace

TileGrid::TileGrid(const Image& size, TexelKind of)
    : kind(of),
      texel(texelBytes(of, size.channels)),
      rows(kTileBytes / (kTileWidth * texel)),
      across((static_cast<std::uint32_t>(size.width) + kTileWidth - 1) / kTileWidth),
      down((static_cast<std::uint32_t>(size.height) + rows - 1) / rows) {}

std::vector<std::byte> packTiles(const Image& image) {
  const TileGrid grid(image, texelKind(image));
  std::vector<std::byte> out(kHeadBytes + grid.count() * kEntryBytes);
  std::vector<std::vector<std::byte>> rows(grid.down);
  // Means are sums in the order of the texels, as textureMean() has them: a thread each.
  tbb::parallel_for(0u, grid.down + 2, [&](std::uint32_t i) {
    if (i < 2) return put(out, 8 + 16 * i, textureMean(image, i == 1));
    rows[i - 2] = packRow(image, grid, i - 2, out);
  });
  put(out, 0, hashOf(std::span<const std::byte>(out).subspan(8)));
  for (const std::vector<std::byte>& row : rows) out.insert(out.end(), row.begin(), row.end());
  return out;
}

TileTable readTileTable(const TexelFile& file, std::uint64_t offset, std::uint64_t bytes,
                        const TileGrid& grid) {
  const std::uint64_t head = kHeadBytes + grid.count() * kEntryBytes;
  if (bytes < head)
    file.bad(offset, fmt::format("ends before the table of {} tiles", grid.count()));
  std::vector<std::byte> table(head);
  file.read(offset, table);
  if (hashOf(std::span<const std::byte>(table).subspan(8)) != valueAt<std::uint64_t>(table, 0)) {
    file.bad(offset, "the table of an image's tiles is damaged");
  }
  TileTable out;
  std::memcpy(static_cast<void*>(out.mean), &table[8], sizeof(out.mean));
  for (const vec4& mean : out.mean) {
    if (!isFinite(vec3(mean)) || !std::isfinite(mean.w)) {
      file.bad(offset, "an image's mean is not finite");
    }
  }
  out.tiles.reserve(grid.count());
  std::uint64_t at = offset + head;
  for (std::uint64_t i = 0; i < grid.count(); ++i) {
    const std::size_t entry = kHeadBytes + i * kEntryBytes;
    const auto size = valueAt<std::uint32_t>(table, entry + 8);
    if (size == 0 || size > grid.bytes() || valueAt<std::uint32_t>(table, entry + 12) != 0) {
      file.bad(offset + entry, fmt::format("tile {} can't have {} bytes", i, size));
    }
    PackedTile& tile = out.tiles.emplace_back();
    tile.offset = at & ((std::uint64_t{1} << 51) - 1);
    tile.bytes = size & 0x1fffu;
    tile.hash = valueAt<std::uint64_t>(table, entry);
    at += size;
  }
  if (at != offset + bytes) {
    file.bad(offset,
             fmt::format("its tiles have {} bytes, not {}", at - offset - head, bytes - head));
  }
  return out;
}

void readTile(const TexelFile& file, const PackedTile& tile, const TileGrid& grid, TileWords& out) {
  thread_local std::unique_ptr<ZSTD_DCtx, FreeContext> zstd(ZSTD_createDCtx());
  thread_local std::vector<std::byte> packed;
  if (!zstd) throw std::bad_alloc();
  packed.resize(tile.bytes);
  file.read(tile.offset, packed);
  if (hashOf(packed) != tile.hash) file.bad(tile.offset, "a tile of an image is damaged");
  const std::span<std::byte> texels = std::as_writable_bytes(std::span(out)).first(grid.bytes());
  if (tile.bytes == grid.bytes()) {
    std::memcpy(texels.data(), packed.data(), packed.size());
  } else {
    const std::size_t got =
        ZSTD_decompressDCtx(zstd.get(), texels.data(), texels.size(), packed.data(), packed.size());
    if (ZSTD_isError(got) || got != texels.size()) {
      file.bad(tile.offset, fmt::format("a tile of an image can't be unpacked: {}",
                                        ZSTD_isError(got) ? ZSTD_getErrorName(got) : "too small"));
    }
  }
  addDifferences(texels, kTileWidth * grid.texel);
  if (!areFinite(texels, grid.kind)) file.bad(tile.offset, "a texel is not finite");
}

}  // namespace trex
