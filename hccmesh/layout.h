// The stored structs of HCCMesh and how their parts are found; FORMAT.md is the authority.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace hccm::layout {

static_assert(std::endian::native == std::endian::little, "the buffer is used as it lies");

inline constexpr std::uint32_t kVersion = 1;
inline constexpr char kMagic[4] = {'H', 'C', 'C', 'M'};
inline constexpr std::uint32_t kMaxTriangles = 128, kMaxVertices = 256, kMaxLeaves = 32;
inline constexpr std::uint32_t kLeafSize = 8;     ///< triangles of a leaf, lanes of a test
inline constexpr std::uint32_t kGroupBytes = 48;  ///< boxes of 8 leaves
inline constexpr std::uint64_t kTailBytes = 32;   ///< wide loads may touch them
inline constexpr std::int32_t kMaxGrid = 1 << 23;
inline constexpr std::uint32_t kMaxWidth = 25;  ///< bits of an offset: 2^24 from end to end
inline constexpr int kMinStepExponent = -110, kMaxStepExponent = 80;

enum Flags : std::uint8_t { kNormals = 1, kTexCoords = 2, kFloatTexCoords = 4, kColors = 8 };

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

struct ClusterHeader {
  std::int32_t anchor[3];  ///< grid
  std::uint32_t material, object;
  std::uint8_t triangleCountLess1, vertexCountLess1, leafCount, indexBits;
  std::uint8_t width[3], flags;
  std::uint8_t boxShift[3], reserved0;
  std::uint8_t top[3], reserved1;
  std::uint16_t topologyOffset, vertexOffset;  ///< bytes from the start of the blob

  std::uint32_t triangles() const { return triangleCountLess1 + 1u; }
  std::uint32_t vertices() const { return vertexCountLess1 + 1u; }
  std::uint32_t groups() const { return leafCount > 1 ? (leafCount + 7u) / 8u : 0u; }
  std::uint32_t vertexBits() const { return std::uint32_t(width[0]) + width[1] + width[2]; }
};
static_assert(sizeof(ClusterHeader) == 40 && alignof(ClusterHeader) == 4 &&
              offsetof(ClusterHeader, width) == 24 && offsetof(ClusterHeader, top) == 32 &&
              offsetof(ClusterHeader, vertexOffset) == 38);

/// Byte offsets of a blob's parts, each where the one before ends.
struct Offsets {
  std::uint32_t boxes, leafStarts, topology, vertices, normals, texCoords, colors, end;
};

inline Offsets offsetsOf(const ClusterHeader& h) {
  Offsets o;
  o.boxes = sizeof(ClusterHeader);
  o.leafStarts = o.boxes + h.groups() * kGroupBytes;
  o.topology = o.leafStarts + (h.leafCount > 1 ? h.leafCount : 0u);
  o.vertices = o.topology + (h.triangles() * 3u * h.indexBits + 7u) / 8u;
  o.normals = (o.vertices + (h.vertices() * h.vertexBits() + 7u) / 8u + 3u) & ~3u;
  o.texCoords = o.normals + ((h.flags & kNormals) ? 4u * h.vertices() : 0u);
  o.colors = o.texCoords;
  if (h.flags & kTexCoords)
    o.colors += (h.flags & kFloatTexCoords) ? 8u * h.vertices() : 16u + 4u * h.vertices();
  o.end = o.colors + ((h.flags & kColors) ? 4u * h.vertices() : 0u);
  return o;
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

}  // namespace hccm::layout
