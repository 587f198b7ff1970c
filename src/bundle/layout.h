// The stored structs of a bundle; FORMAT.md is the authority.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "src/bundle/container.h"

namespace trex::bundle {

static_assert(std::endian::native == std::endian::little, "the file is used as it lies");

inline constexpr char kMagic[8] = {'T', 'R', 'E', 'X', 'b', 'n', 'd', 'l'};
inline constexpr std::uint32_t kByteOrder = 0x01020304u;
inline constexpr std::uint32_t kMaxSections = 1u << 20;

/// The first 4096 bytes.
struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t byteOrder;
  std::uint64_t fileBytes;
  std::uint64_t directoryOffset;  ///< where the last section's padding ends
  std::uint64_t directoryHash;    ///< XXH3-64 from there to the end of the file
  std::uint32_t sectionCount;
  std::uint8_t reserved[4044];  ///< zero
  std::uint64_t hash;           ///< XXH3-64 of the 4088 bytes before
};
static_assert(sizeof(Header) == kAlignment && offsetof(Header, fileBytes) == 16 &&
              offsetof(Header, sectionCount) == 40 && offsetof(Header, reserved) == 44 &&
              offsetof(Header, hash) == 4088);

struct Entry {
  char name[48];  ///< ends with at least one zero
  std::uint64_t offset;
  std::uint64_t bytes;
};
static_assert(sizeof(Entry) == 64 && offsetof(Entry, offset) == 48);

inline std::uint64_t aligned(std::uint64_t bytes) {
  return (bytes + kAlignment - 1) & ~(kAlignment - 1);
}

}  // namespace trex::bundle
