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

/// XXH3-64 of a buffer whose checksum field counts as zero. At least a header long.
std::uint64_t checksumOf(std::span<const std::byte> bytes);

}  // namespace hccm
