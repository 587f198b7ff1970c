// A page: u32 number of blobs, u32 unpacked bytes, u32 size of each blob; then one zstd frame of
// the blobs' bytes.
#include "hccmesh/pack.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <memory>

#include "hccmesh/layout.h"
#include "hccmesh/validate.h"

namespace hccm {
namespace {

constexpr int kLevel = 3;
constexpr std::size_t kHeadBytes = 8;

[[noreturn]] void refuse(const char* what) {
  throw FormatError(std::string("not a valid page of clusters: ") + what);
}

std::uint32_t wordAt(std::span<const std::byte> bytes, std::size_t at) {
  std::uint32_t word;
  std::memcpy(&word, bytes.data() + at, sizeof(word));
  return word;
}

// Contexts are costly to make: one a thread.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(
      ZSTD_createCCtx(), ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  return context.get();
}
ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(
      ZSTD_createDCtx(), ZSTD_freeDCtx);
  if (!context) throw std::bad_alloc();
  return context.get();
}

}  // namespace

std::vector<std::byte> packClusters(std::span<const std::span<const std::byte>> blobs) {
  std::vector<std::byte> plain;
  for (const std::span<const std::byte> blob : blobs) {
    plain.insert(plain.end(), blob.begin(), blob.end());
    if (plain.size() > kMaxPageBytes) throw std::invalid_argument("hccm: a page over 16 MiB");
  }
  const std::size_t head = kHeadBytes + 4 * blobs.size();
  std::vector<std::byte> out(head + ZSTD_compressBound(plain.size()));
  const auto put = [&](std::size_t at, std::size_t value) {
    const auto word = static_cast<std::uint32_t>(value);
    std::memcpy(out.data() + at, &word, sizeof(word));
  };
  put(0, blobs.size());
  put(4, plain.size());
  for (std::size_t i = 0; i < blobs.size(); ++i) put(kHeadBytes + 4 * i, blobs[i].size());
  const std::size_t size = ZSTD_compressCCtx(compressor(), out.data() + head, out.size() - head,
                                             plain.data(), plain.size(), kLevel);
  if (ZSTD_isError(size)) throw std::bad_alloc();
  out.resize(head + size);
  return out;
}

std::uint64_t unpackedBytes(std::span<const std::byte> packed) {
  if (packed.size() < kHeadBytes) refuse("truncated");
  const std::uint32_t bytes = wordAt(packed, 4);
  if (bytes > kMaxPageBytes) refuse("over 16 MiB");
  return bytes + layout::kTailBytes;
}

ClusterPage unpackClusters(std::span<const std::byte> packed) {
  ClusterPage page;
  const std::uint64_t total = unpackedBytes(packed);
  const std::uint64_t count = wordAt(packed, 0), head = kHeadBytes + 4 * count;
  if (head > packed.size()) refuse("truncated");
  page.bytes.resize(total);
  const std::uint64_t size = total - layout::kTailBytes;
  const std::size_t done = ZSTD_decompressDCtx(decompressor(), page.bytes.data(), size,
                                               packed.data() + head, packed.size() - head);
  if (ZSTD_isError(done) || done != size) refuse("damaged data");
  std::uint64_t at = 0;
  page.offsets.reserve(count + 1);
  for (std::uint64_t i = 0; i < count; ++i) {
    page.offsets.push_back(static_cast<std::uint32_t>(at));
    const std::uint64_t bytes = wordAt(packed, kHeadBytes + 4 * i);
    if (bytes > size - at) refuse("a cluster ends outside");
    validateCluster(std::span(page.bytes).subspan(at, bytes), at);
    at += bytes;
  }
  if (at != size) refuse("bytes behind the last cluster");
  page.offsets.push_back(static_cast<std::uint32_t>(at));
  return page;
}

std::uint64_t packedBytes(const Mesh& mesh) {
  constexpr std::uint32_t kClusters = 128;
  const std::uint32_t pages = (mesh.clusterCount() + kClusters - 1) / kClusters;
  return tbb::parallel_reduce(
      tbb::blocked_range<std::uint32_t>(0, pages), std::uint64_t{0},
      [&](const tbb::blocked_range<std::uint32_t>& range, std::uint64_t sum) {
        for (std::uint32_t p = range.begin(); p < range.end(); ++p) {
          std::vector<std::span<const std::byte>> blobs;
          for (std::uint32_t c = p * kClusters;
               c < std::min((p + 1) * kClusters, mesh.clusterCount()); ++c)
            blobs.push_back(mesh.clusterBytes(c));
          sum += packClusters(blobs).size();
        }
        return sum;
      },
      std::plus<>());
}

}  // namespace hccm
