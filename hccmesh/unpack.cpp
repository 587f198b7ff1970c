// Pages back to blobs: the streams of a page are unpacked here, and put together in assemble.cpp.
#include <zstd.h>

#include <cstring>
#include <memory>

#include "hccmesh/layout.h"
#include "hccmesh/pack.h"
#include "hccmesh/page_streams.h"
#include "hccmesh/validate.h"

namespace hccm {

void refusePage(const char* what) {
  throw FormatError(std::string("not a valid page of clusters: ") + what);
}

namespace {

using Header = layout::ClusterHeader;

constexpr std::uint64_t kMostKept = 1u << 20;  // bytes of a page

std::uint32_t wordAt(std::span<const std::byte> bytes, std::size_t at) {
  if (bytes.size() < at + 4) refusePage("truncated");
  std::uint32_t word;
  std::memcpy(&word, bytes.data() + at, sizeof(word));
  return word;
}

// A context is costly to make: one a thread.
ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(
      ZSTD_createDCtx(), ZSTD_freeDCtx);
  if (!context) throw std::bad_alloc();
  return context.get();
}

// The next stream of a page; `at` moves on. Not over `most` bytes.
void readStream(std::span<const std::byte> packed, std::size_t& at, std::uint64_t most,
                Stream& out) {
  const std::uint32_t plain = wordAt(packed, at), size = wordAt(packed, at + 4);
  at += 8;
  if (plain > most || size > packed.size() - at) refusePage("a stream of wrong size");
  out.resize(plain);
  const std::size_t done =
      ZSTD_decompressDCtx(decompressor(), out.data(), plain, packed.data() + at, size);
  if (ZSTD_isError(done) || done != plain) refusePage("damaged data");
  at += size;
}

// Headers, whose bytes lie byte by byte.
std::vector<Header> headersOf(const Stream& stream, std::uint32_t count) {
  if (stream.size() != count * sizeof(Header)) refusePage("wrong number of headers");
  std::vector<Header> headers(count);
  auto* to = reinterpret_cast<std::byte*>(headers.data());
  for (std::size_t byte = 0; byte < sizeof(Header); ++byte)
    for (std::size_t i = 0; i < count; ++i)
      to[i * sizeof(Header) + byte] = stream[byte * count + i];
  for (const Header& h : headers) {
    for (const std::uint8_t width : h.width)
      if (width > layout::kMaxWidth) refusePage("wrong width");
    for (const std::uint8_t shift : h.boxShift)
      if (shift > 24) refusePage("wrong box shift");
  }
  return headers;
}

ClusterPage assemble(std::span<const std::byte> packed, std::uint32_t count, std::uint64_t bytes,
                     bool known) {
  // Memory of a thread, but of what is larger than pages are. Not counted by caches.
  thread_local Streams kept;
  Streams large;
  Streams& streams = bytes > kMostKept ? large : kept;
  std::size_t at = kPageHead;
  streams.forEach([&](Stream& s) { readStream(packed, at, bytes, s); });
  if (at != packed.size()) refusePage("bytes behind the last stream");
  const std::vector<Header> headers = headersOf(streams.headers, count);
  for (const Stream& plane : streams.planes)
    if (plane.size() != streams.planes[0].size()) refusePage("planes of different sizes");
  if (streams.planes[0].size() > std::size_t{count} * layout::kMaxVertices)
    refusePage("too many vertices");
  ClusterPage page;
  page.bytes.resize(bytes + layout::kTailBytes);
  page.offsets.reserve(count + 1);
  assembleClusters(streams, headers, known, page);
  return page;
}

ClusterPage copy(std::span<const std::byte> packed, std::uint32_t count, std::uint64_t bytes,
                 bool known) {
  std::size_t at = kPageHead;
  Stream sizes;
  readStream(packed, at, std::uint64_t{4} * count, sizes);
  ClusterPage page;
  readStream(packed, at, bytes, page.bytes);
  if (at != packed.size() || sizes.size() != std::size_t{4} * count || page.bytes.size() != bytes)
    refusePage("streams of wrong size");
  page.bytes.resize(bytes + layout::kTailBytes);
  std::uint64_t start = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    page.offsets.push_back(static_cast<std::uint32_t>(start));
    const std::uint64_t size = wordAt(sizes, std::size_t{4} * i);
    if (size > bytes - start) refusePage("a cluster ends outside");
    if (!known) validateCluster(std::span(page.bytes).subspan(start, size), start);
    start += size;
  }
  if (start != bytes) refusePage("bytes behind the last cluster");
  page.offsets.push_back(static_cast<std::uint32_t>(start));
  return page;
}

}  // namespace

std::uint64_t unpackedBytes(std::span<const std::byte> packed) {
  const std::uint32_t bytes = wordAt(packed, 4);
  if (bytes > kMaxPageBytes) refusePage("over 16 MiB");
  return bytes + layout::kTailBytes;
}

ClusterPage unpackClusters(std::span<const std::byte> packed, bool known) {
  const std::uint64_t bytes = unpackedBytes(packed) - layout::kTailBytes;
  const std::uint32_t count = wordAt(packed, 0), mode = wordAt(packed, 8);
  if (count > bytes / sizeof(Header)) refusePage("too many clusters");
  if (mode > kArranged) refusePage("unknown mode");
  return mode == kRaw ? copy(packed, count, bytes, known) : assemble(packed, count, bytes, known);
}

}  // namespace hccm
