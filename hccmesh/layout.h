// The stored structs of HCCMesh and how their parts are found; FORMAT.md is the authority.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace hccm::layout {

static_assert(std::endian::native == std::endian::little, "the buffer is used as it lies");

inline constexpr std::uint32_t kVersion = 2;
inline constexpr char kMagic[4] = {'H', 'C', 'C', 'M'};
inline constexpr std::uint32_t kMaxTriangles = 256, kMaxVertices = 255, kMaxLeaves = 64;
inline constexpr std::uint32_t kLeafSize = 8;     ///< triangles of a leaf, lanes of a test
inline constexpr std::uint32_t kMaxEntries = 16;  ///< of a leaf's strip
inline constexpr std::uint32_t kMaxRecord = 24;   ///< bytes of a leaf's record
inline constexpr std::uint64_t kTailBytes = 32;   ///< wide loads may touch them
inline constexpr std::uint32_t kTableShift = 4;   ///< blobs start at multiples of 16 bytes
inline constexpr std::uint32_t kBlobUnit = 1u << kTableShift;
inline constexpr std::int32_t kMaxGrid = 1 << 23;
inline constexpr std::uint32_t kMaxWidth = 25;  ///< bits of an offset: 2^24 from end to end
inline constexpr int kMinStepExponent = -110, kMaxStepExponent = 80;

enum Flags : std::uint8_t {
  kNormals = 1,
  kTexCoords = 2,
  kFloatTexCoords = 4,  ///< only with kTexCoords
  kColors = 8,
  kSecondTexCoords = 16,       ///< only with kTexCoords
  kFloatSecondTexCoords = 32,  ///< only with kSecondTexCoords
  kAllFlags = 63
};

struct Header {
  char magic[4];
  std::uint32_t version;
  std::uint64_t byteSize;
  std::uint64_t checksum;  ///< XXH3-64 of the buffer with this field zero
  double gridOrigin[3];    ///< metres
  double errorBound;       ///< metres
  std::uint64_t triangleCount, droppedTriangles;
  std::int32_t stepExponent;
  std::uint32_t clusterCount;
  std::int32_t lower[3], upper[3];  ///< grid
  std::uint8_t reserved[8];
};
static_assert(sizeof(Header) == 112 && offsetof(Header, checksum) == 16 &&
              offsetof(Header, gridOrigin) == 24 && offsetof(Header, stepExponent) == 72 &&
              offsetof(Header, lower) == 80 && offsetof(Header, reserved) == 104);

/// Where the first blob starts: behind the table, padded.
inline std::uint64_t firstBlob(std::uint64_t clusters) {
  return (sizeof(Header) + 4ull * clusters + kBlobUnit - 1u) & ~std::uint64_t(kBlobUnit - 1u);
}

/// Bytes from the start of the buffer to the blob of an entry of the table.
inline std::uint64_t blobOffset(std::uint32_t entry) { return std::uint64_t(entry) << kTableShift; }

struct ClusterHeader {
  std::int32_t lower[3];  ///< grid; least coordinates of the vertices
  std::uint32_t material, object;
  std::uint8_t triangleCountLess1, vertexCount, leafCount, flags;
  std::uint8_t width[3], boxShift[3], top[3], reserved;
  std::uint16_t vertexOffset;  ///< bytes from the start of the blob

  std::uint32_t triangles() const { return triangleCountLess1 + 1u; }
  std::uint32_t vertices() const { return vertexCount; }
  std::uint32_t groups() const { return (leafCount + 7u) / 8u; }
  std::uint32_t vertexBits() const { return std::uint32_t(width[0]) + width[1] + width[2]; }
};
static_assert(sizeof(ClusterHeader) == 36 && alignof(ClusterHeader) == 4 &&
              offsetof(ClusterHeader, material) == 12 && offsetof(ClusterHeader, width) == 24 &&
              offsetof(ClusterHeader, top) == 30 && offsetof(ClusterHeader, vertexOffset) == 34);

/// Where records start, bytes from the start of the blob.
inline std::uint32_t recordsOf(const ClusterHeader& h) {
  const std::uint32_t boxes = h.leafCount > 1 ? 6u * h.leafCount : 0u;
  return static_cast<std::uint32_t>(sizeof(h)) + boxes + 2u * h.groups() + h.leafCount;
}

/// Byte offsets of a blob's parts, each where the one before ends (records: up to vertices).
struct Offsets {
  std::uint32_t boxes, groupStarts, leafStarts, records, vertices, normals, texCoords, colors,
      secondTexCoords, attributesEnd, end;
};

/// Of one set of texture coordinates.
inline std::uint32_t texCoordBytes(const ClusterHeader& h, bool floats) {
  return floats ? 8u * h.vertices() : 16u + 4u * h.vertices();
}

/// Inlined, so that a reader of one part works out no more than that needs.
[[gnu::always_inline]] inline Offsets offsetsOf(const ClusterHeader& h) {
  Offsets o;
  o.boxes = sizeof(ClusterHeader);
  o.groupStarts = o.boxes + (h.leafCount > 1 ? 6u * h.leafCount : 0u);
  o.leafStarts = o.groupStarts + 2u * h.groups();
  o.records = recordsOf(h);
  o.vertices = h.vertexOffset;
  const std::uint32_t vertexBytes = (h.vertices() * h.vertexBits() + 7u) / 8u;
  const bool attributes = (h.flags & (kNormals | kTexCoords | kColors)) != 0;
  o.normals = o.vertices + vertexBytes;
  if (attributes) o.normals = (o.normals + 3u) & ~3u;
  o.texCoords = o.normals + ((h.flags & kNormals) ? 4u * h.vertices() : 0u);
  o.colors = o.texCoords;
  if (h.flags & kTexCoords) o.colors += texCoordBytes(h, (h.flags & kFloatTexCoords) != 0);
  o.secondTexCoords = o.colors + ((h.flags & kColors) ? 4u * h.vertices() : 0u);
  o.attributesEnd = o.secondTexCoords;
  if (h.flags & kSecondTexCoords)
    o.attributesEnd += texCoordBytes(h, (h.flags & kFloatSecondTexCoords) != 0);
  o.end = (o.attributesEnd + kBlobUnit - 1u) & ~(kBlobUnit - 1u);
  return o;
}

/// Where a leaf's record starts, bytes from the start of the blob.
inline std::uint32_t recordOffset(const std::byte* blob, const ClusterHeader& h,
                                  std::uint32_t leaf) {
  const std::uint32_t groupStarts =
      sizeof(ClusterHeader) + (h.leafCount > 1 ? 6u * h.leafCount : 0u);
  std::uint16_t group;
  std::memcpy(&group, blob + groupStarts + 2u * (leaf / 8u), sizeof(group));
  return group + std::to_integer<std::uint32_t>(blob[groupStarts + 2u * h.groups() + leaf]);
}

/// Reads `bits` <= 32 bits at bit `position` of a stream; touches 8 bytes.
inline std::uint32_t readBits(const std::byte* stream, std::uint32_t position, std::uint32_t bits) {
  std::uint64_t word;
  std::memcpy(&word, stream + position / 8u, sizeof(word));
  return static_cast<std::uint32_t>((word >> (position & 7u)) & ((1ull << bits) - 1ull));
}

/// Writes into zeroed bytes what readBits() reads; touches only the bytes that hold the bits.
inline void writeBits(std::byte* stream, std::uint32_t position, std::uint32_t bits,
                      std::uint32_t value) {
  std::uint64_t word = std::uint64_t(value) << (position & 7u);
  std::byte* at = stream + position / 8u;
  for (std::uint32_t left = bits + (position & 7u); left > 0; left -= left < 8u ? left : 8u) {
    *at++ |= static_cast<std::byte>(word & 0xffu);
    word >>= 8;
  }
}

/// Grid coordinates of a vertex.
inline void readVertex(const std::byte* vertices, const ClusterHeader& h, std::uint32_t vertex,
                       std::int32_t* grid) {
  std::uint32_t bit = vertex * h.vertexBits();
  for (int k = 0; k < 3; ++k) {
    grid[k] = h.lower[k] + static_cast<std::int32_t>(readBits(vertices, bit, h.width[k]));
    bit += h.width[k];
  }
}

}  // namespace hccm::layout
