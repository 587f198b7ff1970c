// The check that every buffer passes before it is traced.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace hccm {

/// Checks all sizes, offsets, widths, indices, boxes, padding and the checksum against FORMAT.md.
/// Throws FormatError. Uses oneTBB; thread safe.
void validate(std::span<const std::byte> bytes);

/// XXH3-64 of a buffer whose checksum field counts as zero. At least a header long.
std::uint64_t checksumOf(std::span<const std::byte> bytes);

}  // namespace hccm
