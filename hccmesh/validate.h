// The check that every buffer passes before it is traced.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hccm {

/// Checks all sizes, offsets, widths, indices, boxes, padding and the checksum against FORMAT.md.
/// Throws FormatError. Uses oneTBB; thread safe.
void validate(std::span<const std::byte> bytes);

/// Grid bounds and number of triangles of one cluster.
struct ClusterSummary {
  std::int32_t lower[3], upper[3];
  std::uint32_t triangles;
};

/// Checks one whole blob as validate() does; kTailBytes behind it must be readable. `at` is where
/// it lies, for the message. Throws FormatError. Thread safe.
ClusterSummary validateCluster(std::span<const std::byte> blob, std::uint64_t at);

/// Of a blob that was put together from a page's streams what does not follow from that: counts and
/// flags of its header, the bounds there, which must be those of its vertices (offsets from `least`
/// to `most`, three each, at most kMaxWidth bits), its `triangles`, and texture coordinates. What
/// passes, passes validateCluster(). Throws FormatError. Thread safe.
void validateAssembled(const std::byte* blob, std::uint32_t triangles, const std::uint32_t* least,
                       const std::uint32_t* most, std::uint64_t at);

/// XXH3-64 of a buffer whose checksum field counts as zero. At least a header long.
std::uint64_t checksumOf(std::span<const std::byte> bytes);

}  // namespace hccm
