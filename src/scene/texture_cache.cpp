#include "src/scene/texture_cache.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <new>

#include "src/core/error.h"
#include "src/core/memory.h"
#include "src/scene/temporary_file.h"
#include "src/scene/texels.h"

namespace trex {
namespace {

std::uint32_t wordAt(const std::uint32_t* words, std::uint32_t index) {
  return std::atomic_ref(const_cast<std::uint32_t&>(words[index])).load(std::memory_order_relaxed);
}

/// `count` bytes at a byte offset, which a texel may share a word with others at either end.
void copyTexel(const std::uint32_t* words, std::uint32_t offset, std::uint32_t count,
               std::byte* out) {
  const std::uint32_t first = offset / 4, shift = offset % 4;
  if (count <= 4) {
    const std::uint64_t low = wordAt(words, first);
    const std::uint64_t high = wordAt(words, (offset + count - 1) / 4);
    const auto bytes = static_cast<std::uint32_t>((low | high << 32) >> (8 * shift));
    std::memcpy(out, &bytes, sizeof(bytes));
    return;
  }
  std::uint32_t taken[5];
  for (std::uint32_t i = first; i <= (offset + count - 1) / 4; ++i) {
    taken[i - first] = wordAt(words, i);
  }
  std::memcpy(out, reinterpret_cast<const std::byte*>(taken) + shift, count);
}

}  // namespace

PagedTexels::PagedTexels(const Image& size, TexelKind kind, std::shared_ptr<const TexelFile> file,
                         std::uint64_t offset, std::uint64_t bytes,
                         std::shared_ptr<TextureCache> cache)
    : grid_(size, kind),
      width_(size.width),
      height_(size.height),
      channels_(size.channels),
      file_(std::move(file)),
      offset_(offset),
      bytes_(bytes),
      cache_(std::move(cache)),
      tiles_(std::make_unique<Tile[]>(grid_.count())) {
  const TileTable table = readTileTable(*file_, offset, bytes, grid_);
  for (int i = 0; i < 2; ++i) mean_[i] = table.mean[i];
  for (std::uint64_t i = 0; i < grid_.count(); ++i) tiles_[i].packed = table.tiles[i];
}

PagedTexels::~PagedTexels() {
  if (cache_) cache_->forget(tiles_.get(), tiles_.get() + grid_.count());
}

PagedTexels::Spot PagedTexels::spot(int x, int y) const {
  const auto column = static_cast<std::uint32_t>(x), row = static_cast<std::uint32_t>(y);
  const std::uint32_t down = row / grid_.rows, inside = row - down * grid_.rows;
  return {&tiles_[std::uint64_t{down} * grid_.across + column / kTileWidth],
          (inside * kTileWidth + column % kTileWidth) * grid_.texel};
}

void PagedTexels::read(const ivec2& columns, const ivec2& rows, Four& out) const {
  Spot spots[4];
  bool together = true;
  for (int i = 0; i < 4; ++i) {
    spots[i] = spot(columns[i % 2], rows[i / 2]);
    together &= spots[i].tile == spots[0].tile;
  }
  if (together && cache_->copy(spots, 4, grid_.texel, out.texels)) return;
  for (int i = 0; i < 4; ++i) {
    std::byte* const to = out.texels + static_cast<std::size_t>(i) * Four::kStride;
    if (!cache_->copy(&spots[i], 1, grid_.texel, to)) cache_->load(*this, spots[i], to);
  }
}

void PagedTexels::ask(int column, const ivec2& rows) const {
  const Spot spots[2] = {spot(column, rows.x), spot(column, rows.y)};
  for (int i = 0; i < 2; ++i) {
    const std::uint64_t place = spots[i].tile->place.load(std::memory_order_relaxed);
    if (place != 0) {
      __builtin_prefetch(cache_->slotAt((place & 0xffffffffu) - 1) + spots[i].offset / 4);
    } else if (i == 0 || spots[1].tile != spots[0].tile) {
      file_->readAhead(spots[i].tile->packed.offset, spots[i].tile->packed.bytes);
    }
  }
}

void PagedTexels::whole(Image& out) const {
  const std::span<std::byte> all = makeTexels(out, kind());
  TileWords words;
  const auto width = static_cast<std::size_t>(width_);
  for (std::uint64_t i = 0; i < grid_.count(); ++i) {
    readTile(*file_, tiles_[i].packed, grid_, words);
    const std::size_t x = i % grid_.across * kTileWidth, y = i / grid_.across * grid_.rows;
    const std::size_t count = std::min<std::size_t>(kTileWidth, width - x) * grid_.texel;
    const std::size_t rows = std::min<std::size_t>(grid_.rows, std::size_t(height_) - y);
    const auto* from = reinterpret_cast<const std::byte*>(words.data());
    for (std::size_t row = 0; row < rows; ++row) {
      std::memcpy(&all[((y + row) * width + x) * grid_.texel],
                  from + row * kTileWidth * grid_.texel, count);
    }
  }
}

std::shared_ptr<const std::span<const std::byte>> PagedTexels::packed() const {
  if (auto mapped = file_->map(offset_, bytes_)) return mapped;
  using Bytes = std::span<const std::byte>;
  auto copy = std::make_shared<std::vector<std::byte>>(bytes_);
  file_->read(offset_, *copy);
  return {new Bytes(*copy), [copy](const Bytes* view) { delete view; }};
}

TextureCache::TextureCache(std::uint64_t limit, std::uint64_t maxMemory,
                           std::filesystem::path folder)
    : limit_(std::min(limit, availableMemoryLimit())),
      maxMemory_(maxMemory),
      folder_(std::move(folder)) {}

TextureCache::~TextureCache() {
  if (pool_ != nullptr) ::munmap(pool_, poolSlots_ * kTileBytes);
}

void TextureCache::admit(std::vector<Image>& images) {
  count(images);
  if (!paging_ && fixed_ <= limit_) return;
  paging_ = true;
  for (Image& image : images) {
    if (wholeTexels(image).size() > kTileBytes) putAside(image);
  }
  count(images);
  const std::uint64_t least = fixed_ + kLeastPool;
  if (least > limit_) {
    fail(ExitCode::kMemoryOrDevice,
         "textures: {} in {} images need at least {} of memory, {} are allowed; make "
         "--texture-memory or --max-memory larger",
         formatBytes(statistics_.texelBytes), images.size(), formatBytes(least),
         formatBytes(limit_));
  }
  makePool();
  shrinkTo((limit_ - fixed_) / kSlotCost);
}

void TextureCache::putAside(Image& image) {
  if (!aside_) aside_ = std::make_shared<detail::TemporaryTexels>(folder_);
  const TexelKind kind = texelKind(image);
  const std::vector<std::byte> packed = packTiles(image);
  const std::uint64_t offset = aside_->append(packed);
  std::vector<std::uint8_t>().swap(image.bytes);
  std::vector<std::uint16_t>().swap(image.words);
  std::vector<float>().swap(image.floats);
  image.paged = std::make_shared<const PagedTexels>(image, kind, aside_, offset, packed.size(),
                                                    shared_from_this());
}

void TextureCache::count(const std::vector<Image>& images) {
  const std::lock_guard lock(mutex_);
  fixed_ = statistics_.texelBytes = statistics_.pagedImages = 0;
  for (const Image& image : images) {
    if (!hasTexels(image)) continue;
    statistics_.texelBytes += texelBytes(image, texelKind(image));
    statistics_.pagedImages += image.paged ? 1 : 0;
    fixed_ += image.paged ? image.paged->tableBytes() : wholeTexels(image).size();
  }
  paging_ |= statistics_.pagedImages > 0;
  // What is whole beyond the limit is put aside before anything else is read.
  if (fixed_ <= limit_) statistics_.peakBytes = std::max(statistics_.peakBytes, bytesNow());
}

/// Addresses for as many slots as the limit may ever give; memory comes as they are filled.
void TextureCache::makePool() {
  if (pool_ != nullptr) return;
  const std::uint64_t slots = std::min<std::uint64_t>(limit_ / kSlotCost, 0xfffffffeu);
  void* const at = ::mmap(nullptr, slots * kTileBytes, PROT_READ | PROT_WRITE,
                          MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED) {
    fail(ExitCode::kMemoryOrDevice,
         "textures: no room for {} of tiles; make --texture-memory "
         "smaller",
         formatBytes(slots * kTileBytes));
  }
  pool_ = static_cast<std::uint32_t*>(at);
  poolSlots_ = slots;
  used_ = std::make_unique<std::atomic<std::uint8_t>[]>(slots);
}

/// Gives up the last slots until there are no more than these.
void TextureCache::shrinkTo(std::uint64_t slots) {
  const std::lock_guard lock(mutex_);
  mostSlots_ = std::min(slots, poolSlots_);
  if (owners_.size() <= mostSlots_) return;
  for (std::uint64_t i = mostSlots_; i < owners_.size(); ++i) {
    if (owners_[i] != nullptr) owners_[i]->place.store(0);
  }
  std::erase_if(free_, [&](std::uint64_t slot) { return slot >= mostSlots_; });
  ::madvise(slotAt(mostSlots_), (owners_.size() - mostSlots_) * kTileBytes, MADV_DONTNEED);
  owners_.resize(mostSlots_);
  hand_ = 0;
}

/// Texels of one tile, `texel` bytes each, to places of PagedTexels::Four. False if it is absent,
/// or was replaced meanwhile.
bool TextureCache::copy(const PagedTexels::Spot* spots, std::size_t count, std::uint32_t texel,
                        std::byte* out) const {
  const std::atomic<std::uint64_t>& at = spots[0].tile->place;
  const std::uint64_t place = at.load(std::memory_order_acquire);
  if (place == 0) return false;
  const std::uint64_t slot = (place & 0xffffffffu) - 1;
  for (std::size_t i = 0; i < count; ++i) {
    copyTexel(slotAt(slot), spots[i].offset, texel, out + i * PagedTexels::Four::kStride);
  }
  // With the fence of insert(): texels of another tile come with a place that has changed.
  std::atomic_thread_fence(std::memory_order_acquire);
  if (at.load(std::memory_order_relaxed) != place) return false;
  if (used_[slot].load(std::memory_order_relaxed) == 0) {
    used_[slot].store(1, std::memory_order_relaxed);
  }
  return true;
}

void TextureCache::load(const PagedTexels& image, const PagedTexels::Spot& spot, std::byte* out) {
  thread_local TileWords words;
  readTile(*image.file_, spot.tile->packed, image.grid_, words);
  copyTexel(words.data(), spot.offset, image.grid_.texel, out);
  insert(*spot.tile, words);
}

void TextureCache::insert(PagedTexels::Tile& tile, const TileWords& words) {
  const std::lock_guard lock(mutex_);
  ++statistics_.loads;
  statistics_.bytesRead += tile.packed.bytes;
  if (tile.place.load(std::memory_order_relaxed) != 0) return;  // another thread was faster
  const std::uint64_t slot = freeSlot();
  // What is written below is not seen before the place of the tile that had the slot is gone.
  std::atomic_thread_fence(std::memory_order_release);
  std::uint32_t* const to = slotAt(slot);
  for (std::size_t i = 0; i < words.size(); ++i) {
    std::atomic_ref(to[i]).store(words[i], std::memory_order_relaxed);
  }
  owners_[slot] = &tile;
  used_[slot].store(1, std::memory_order_relaxed);
  tile.place.store(std::uint64_t{++generation_} << 32 | (slot + 1), std::memory_order_release);
}

/// A slot that no tile is in: a new one, or that of the first that was not used since the hand
/// passed.
std::uint64_t TextureCache::freeSlot() {
  if (owners_.size() < mostSlots_) {
    owners_.push_back(nullptr);
    statistics_.peakBytes = std::max(statistics_.peakBytes, bytesNow());
    return owners_.size() - 1;
  }
  if (!free_.empty()) {
    const std::uint64_t slot = free_.back();
    free_.pop_back();
    return slot;
  }
  for (;; ++hand_) {
    if (hand_ >= owners_.size()) hand_ = 0;
    if (used_[hand_].exchange(0) == 0) break;
  }
  const std::uint64_t slot = hand_++;
  owners_[slot]->place.store(0, std::memory_order_relaxed);
  ++statistics_.evictions;
  return slot;
}

/// Takes the tiles of an image that goes out of their slots.
void TextureCache::forget(const PagedTexels::Tile* begin, const PagedTexels::Tile* end) {
  const std::lock_guard lock(mutex_);
  for (const PagedTexels::Tile* tile = begin; tile != end; ++tile) {
    const std::uint64_t place = tile->place.load(std::memory_order_relaxed);
    if (place == 0) continue;
    const std::uint64_t slot = (place & 0xffffffffu) - 1;
    owners_[slot] = nullptr;
    free_.push_back(slot);
  }
}

TextureCache::Statistics TextureCache::statistics() const {
  const std::lock_guard lock(mutex_);
  Statistics out = statistics_;
  out.bytes = bytesNow();
  return out;
}

TextureCache::Statistics textureStatistics(const Scene& scene) {
  if (scene.textures) return scene.textures->statistics();
  TextureCache::Statistics out;
  for (const Image& image : scene.images) out.texelBytes += wholeTexels(image).size();
  out.bytes = out.peakBytes = out.texelBytes;
  return out;
}

Image inMemory(const Image& image) {
  Image out = image;
  if (image.paged) image.paged->whole(out);
  out.paged.reset();
  return out;
}

int addImage(Scene& scene, Image image) {
  scene.images.push_back(std::move(image));
  if (scene.textures) scene.textures->admit(scene.images);
  return static_cast<int>(scene.images.size()) - 1;
}

}  // namespace trex
