// Textures under a limit of memory. While all images of a scene fit they are whole in memory, and
// nothing here is in the way. Once they don't, those of more than a tile lie packed on disk (in
// their bundle, or put aside in a temporary file), and tiles come when they are read:
//
//   sampleTexture ─ Image::paged ─► place of the tile ─ there ─► its texels in the pool
//                                          └─ absent ─► file ─ check, unpack ─► a slot of the pool
//
// The pool has slots of one size, as many as the limit leaves. Readers take no lock and write
// nothing but a mark of use: they copy texels out and then look whether the tile was still in its
// place meanwhile [Lameter 2005, sequence locks; Boehm 2012]. Who misses a tile takes its texels
// from what was unpacked, so every reader gets on with a pool of any size. Tiles that were not used
// since a clock's hand passed go first. Texels are those of the whole image, whatever the limit.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "src/scene/scene.h"
#include "src/scene/texel_tiles.h"

namespace trex {

namespace detail {
class TemporaryTexels;
}

/// An image that lies packed in a file. All const calls are thread safe, and throw Error that names
/// the file if it can't be read or is damaged.
class PagedTexels {
 public:
  struct Tile {
    std::atomic<std::uint64_t> place{0};  ///< a slot's number from 1 and its generation; 0: absent
    PackedTile packed;
  };
  /// Texels of a bilinear sample, as they lie in memory: the upper two, then the lower two.
  struct Four {
    static constexpr std::size_t kStride = 16;  ///< bytes
    alignas(16) std::byte texels[4 * kStride];
  };

  /// `size`: width, height and channels. The image takes `bytes` from `offset` on. `cache` may be
  /// null for who only takes it whole().
  PagedTexels(const Image& size, TexelKind kind, std::shared_ptr<const TexelFile> file,
              std::uint64_t offset, std::uint64_t bytes, std::shared_ptr<TextureCache> cache);
  ~PagedTexels();
  PagedTexels(const PagedTexels&) = delete;
  PagedTexels& operator=(const PagedTexels&) = delete;

  TexelKind kind() const { return grid_.kind; }
  int channels() const { return channels_; }
  /// Of all texels, linear; `srgb`: how bytes are meant.
  vec4 mean(bool srgb) const { return mean_[srgb ? 1 : 0]; }
  /// Bytes of the table of tiles in memory.
  std::uint64_t tableBytes() const { return grid_.count() * sizeof(Tile); }

  /// Texels (columns[i % 2], rows[i / 2]), all within the image.
  void read(const ivec2& columns, const ivec2& rows, Four& out) const;
  /// Asks memory, or the disk, for texels that will be read.
  void ask(int column, const ivec2& rows) const;
  /// Fills an image of the same size, whole in memory.
  void whole(Image& out) const;
  /// As it lies in the file: a map of it where that can be had, else a copy.
  std::shared_ptr<const std::span<const std::byte>> packed() const;

 private:
  friend class TextureCache;
  struct Spot {
    Tile* tile;
    std::uint32_t offset;  ///< bytes
  };
  Spot spot(int x, int y) const;

  const TileGrid grid_;
  const int width_, height_, channels_;
  const std::shared_ptr<const TexelFile> file_;
  const std::uint64_t offset_, bytes_;
  const std::shared_ptr<TextureCache> cache_;
  vec4 mean_[2];
  std::unique_ptr<Tile[]> tiles_;  ///< whose places change
};

/// The pool, and the images that keep to one limit together. Images may outlive it.
class TextureCache : public std::enable_shared_from_this<TextureCache> {
 public:
  /// Beside images of a tile and the tables: less would read each tile again and again.
  static constexpr std::uint64_t kLeastPool = 1u << 20;

  struct Statistics {
    std::uint64_t texelBytes = 0;            ///< of all images, as they would lie in memory
    std::uint64_t bytes = 0, peakBytes = 0;  ///< in memory: whole images, tables, tiles
    std::uint64_t pagedImages = 0, loads = 0, evictions = 0, bytesRead = 0;
  };

  /// `limit`: bytes of texels in memory. `maxMemory`: of the process, 0: what the machine has.
  /// `folder`: for the temporary file.
  TextureCache(std::uint64_t limit, std::uint64_t maxMemory, std::filesystem::path folder);
  ~TextureCache();
  TextureCache(const TextureCache&) = delete;
  TextureCache& operator=(const TextureCache&) = delete;

  std::uint64_t limit() const { return limit_; }
  std::uint64_t maxMemory() const { return maxMemory_; }
  /// Counts the images of a scene anew and, if they have outgrown the limit, puts those of more
  /// than a tile aside. Not while any are read. Throws Error(kMemoryOrDevice) if the least that
  /// must stay does not fit, Error(kOutput) if the disk is full.
  void admit(std::vector<Image>& images);
  /// Whether images of so many bytes would all stay in memory.
  bool fits(std::uint64_t texelBytes) const { return !paging_ && texelBytes <= limit_; }
  /// Thread safe.
  Statistics statistics() const;

 private:
  friend class PagedTexels;
  static constexpr std::uint64_t kSlotCost = kTileBytes + 16;
  void putAside(Image& image);
  void count(const std::vector<Image>& images);
  void makePool();
  void shrinkTo(std::uint64_t slots);
  std::uint32_t* slotAt(std::uint64_t slot) const { return pool_ + slot * (kTileBytes / 4); }
  bool copy(const PagedTexels::Spot* spots, std::size_t count, std::uint32_t texel,
            std::byte* out) const;
  void load(const PagedTexels& image, const PagedTexels::Spot& spot, std::byte* out);
  void insert(PagedTexels::Tile& tile, const TileWords& words);
  std::uint64_t freeSlot();
  void forget(const PagedTexels::Tile* begin, const PagedTexels::Tile* end);
  std::uint64_t bytesNow() const { return fixed_ + owners_.size() * kSlotCost; }

  const std::uint64_t limit_, maxMemory_;
  const std::filesystem::path folder_;
  std::shared_ptr<detail::TemporaryTexels> aside_;
  bool paging_ = false;

  std::uint32_t* pool_ = nullptr;  ///< mapped; read and written by atomic_ref alone
  std::uint64_t poolSlots_ = 0;    ///< that there are addresses for
  std::unique_ptr<std::atomic<std::uint8_t>[]> used_;  ///< by slot, since the hand passed

  mutable std::mutex mutex_;  ///< of what follows
  std::uint64_t mostSlots_ = 0, fixed_ = 0;
  std::vector<PagedTexels::Tile*> owners_;  ///< by slot in use; null: free
  std::vector<std::uint64_t> free_;         ///< of these
  std::size_t hand_ = 0;
  std::uint32_t generation_ = 0;  ///< of the slot that was filled last
  Statistics statistics_;
};

/// Of the images of a scene, whether or not they keep to a limit. Thread safe.
TextureCache::Statistics textureStatistics(const Scene& scene);

/// An image with its texels whole in memory.
Image inMemory(const Image& image);

/// Adds an image to a scene, within its limit of textures. Returns its number. Other images of the
/// scene may move.
int addImage(Scene& scene, Image image);

}  // namespace trex
