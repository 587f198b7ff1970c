// Pages of clusters as they lie on disk: the bytes of 64 to 256 KiB of blobs, losslessly
// compressed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hccmesh/hccmesh.h"

namespace hccm {

/// Largest page: unpacked bytes of all blobs together.
inline constexpr std::uint64_t kMaxPageBytes = std::uint64_t{1} << 24;

/// The blobs of a page, one behind the other, and 32 zero bytes that wide loads may touch. Every
/// offset is a multiple of 4 (of the blob format's alignment); bytes.data() is as aligned as new.
struct ClusterPage {
  std::vector<std::byte> bytes;
  std::vector<std::uint32_t> offsets;  ///< of each blob, and one more: where the last one ends

  std::size_t count() const { return offsets.empty() ? 0 : offsets.size() - 1; }
  const std::byte* blob(std::size_t i) const { return bytes.data() + offsets[i]; }
};

/// Packs whole valid blobs, as the encoder made them; equal input gives equal bytes. Behind each,
/// 32 bytes must be readable, as in a mesh's buffer: wide loads touch them. Throws
/// std::invalid_argument if they are over kMaxPageBytes in all or no blobs. Thread safe.
std::vector<std::byte> packClusters(std::span<const std::span<const std::byte>> blobs);

/// The blobs again, bit for bit. Takes anything: every blob is validated, so that tracing it reads
/// nothing outside of the page. `known`: the same bytes have passed before, so that need not be
/// looked at again. Throws FormatError. Thread safe.
ClusterPage unpackClusters(std::span<const std::byte> packed, bool known = false);

/// What unpackClusters() will need in `bytes`, from the first bytes of the packed page. Throws
/// FormatError.
std::uint64_t unpackedBytes(std::span<const std::byte> packed);

/// Bytes of a whole mesh on disk: all its clusters packed in pages of about 128 KiB. oneTBB.
std::uint64_t packedBytes(const Mesh& mesh);

}  // namespace hccm
