// A page: u32 number of blobs, u32 unpacked bytes, u32 mode, then streams, each as u32 plain bytes,
// u32 packed bytes and a zstd frame. Mode 0 has sizes (u32 each) and bytes of blobs. Mode 1 leaves
// out what follows from the rest (boxes, places of leaves and vertices, numbers of first fresh
// vertices) and has
//   headers, byte by byte of all; records without references; references as distances behind the
//   first fresh vertex; attributes with padding;
//   for each axis four byte planes of vertices, as zigzag differences from a prediction: the
//   parallelogram over the strip's last triangle, else the entry before, else the vertex before.
#include "hccmesh/pack.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <iterator>
#include <memory>
#include <utility>

#include "hccmesh/boxes.h"
#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"
#include "hccmesh/page_streams.h"

namespace hccm {
namespace {

using Header = layout::ClusterHeader;

constexpr int kLevel = 3;

// A context is costly to make: one a thread.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(
      ZSTD_createCCtx(), ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  return context.get();
}
void append(Stream& out, const void* from, std::size_t bytes) {
  const std::size_t start = out.size();
  out.resize(start + bytes);
  if (bytes > 0) std::memcpy(out.data() + start, from, bytes);
}
void appendWord(Stream& out, std::size_t value) {
  const auto word = static_cast<std::uint32_t>(value);
  append(out, &word, sizeof(word));
}

/// Low bytes of vertices hardly repeat each other: what zstd finds in them saves less than it
/// costs, in bytes too, and takes a third of the time of unpacking. So they have no matches, but
/// Huffman's code for each byte. False if this zstd can't be told.
bool withoutMatches(ZSTD_CCtx* to) {
  // ZSTD_c_literalCompressionMode of the headers for static linking; 1: Huffman's code wherever it
  // is shorter, which the fastest strategy would leave out.
  const std::pair<ZSTD_cParameter, int> all[] = {{ZSTD_c_strategy, ZSTD_fast},
                                                 {ZSTD_c_minMatch, 7},
                                                 {ZSTD_c_targetLength, 1 << 17},
                                                 {ZSTD_c_experimentalParam5, 1}};
  return std::none_of(std::begin(all), std::end(all), [&](const auto& p) {
    return ZSTD_isError(ZSTD_CCtx_setParameter(to, p.first, p.second)) != 0;
  });
}

void writeStream(Stream& out, const Stream& plain, bool matches = true) {
  ZSTD_CCtx* const context = compressor();
  ZSTD_CCtx_reset(context, ZSTD_reset_session_and_parameters);
  if (!matches && !withoutMatches(context))
    ZSTD_CCtx_reset(context, ZSTD_reset_session_and_parameters);
  ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, kLevel);
  const std::size_t head = out.size();
  appendWord(out, plain.size());
  appendWord(out, 0);
  const std::size_t start = out.size();
  out.resize(start + ZSTD_compressBound(plain.size()));
  const std::size_t size =
      ZSTD_compress2(context, out.data() + start, out.size() - start, plain.data(), plain.size());
  if (ZSTD_isError(size)) throw std::bad_alloc();
  out.resize(start + size);
  const auto word = static_cast<std::uint32_t>(size);
  std::memcpy(out.data() + head + 4, &word, sizeof(word));
}

// What a vertex is likely to be: from entries of its strip whose vertices are known before it.
struct Predictor {
  const std::int32_t (*offset)[3];  ///< of vertices, by number
  const LeafTopology& leaf;

  std::int32_t at(std::uint32_t entry, int axis) const {
    return offset[leaf.vertex[leaf.entry[entry]]][axis];
  }
  std::int32_t predict(std::uint32_t entry, std::uint32_t vertex, int axis) const {
    if (entry == 0) return vertex > 0 ? offset[vertex - 1][axis] : 0;
    const bool inside = (parallelograms(leaf.starts) >> entry & 1u) != 0;
    return inside ? at(entry - 1, axis) + at(entry - 2, axis) - at(entry - 3, axis)
                  : at(entry - 1, axis);
  }
};

std::uint32_t zigzag(std::int32_t v) {
  return static_cast<std::uint32_t>(v) << 1 ^ static_cast<std::uint32_t>(v >> 31);
}
// Calls `visit(entry, vertex)` for each fresh vertex of a leaf, in order.
template <typename Visit>
void forEachFresh(const LeafTopology& leaf, const Visit& visit) {
  std::uint32_t locals = 0, next = leaf.firstFresh;
  for (std::uint32_t i = 0; i < leaf.size; ++i) {
    if (leaf.entry[i] != locals) continue;
    if (leaf.vertex[locals++] == next && next < leaf.firstFresh + leaf.fresh) visit(i, next++);
  }
}

// Takes a blob apart. False if its boxes are not the ones that follow from the vertices.
bool takeApart(std::span<const std::byte> blob, Streams& out) {
  Header h;
  std::memcpy(&h, blob.data(), sizeof(h));
  const layout::Offsets o = layout::offsetsOf(h);
  std::int32_t offset[layout::kMaxVertices][3];
  for (std::uint32_t v = 0; v < h.vertices(); ++v) {
    layout::readVertex(blob.data() + o.vertices, h, v, offset[v]);
    for (int k = 0; k < 3; ++k) offset[v][k] -= h.lower[k];
  }
  for (std::uint32_t i = 0; i < h.leafCount; ++i) {
    const std::byte* record = blob.data() + layout::recordOffset(blob.data(), h, i);
    const LeafTopology leaf = readLeaf(record);
    std::uint8_t planes[6];
    leafBox(leaf, offset, h.boxShift, planes);
    for (std::uint32_t p = 0; p < 6 && h.leafCount > 1; ++p)
      if (blob[o.boxes + p * h.leafCount + i] != static_cast<std::byte>(planes[p])) return false;
    append(out.heads, record + 1, leaf.headBytes - 1);
    for (std::uint32_t r = leaf.headBytes; r < leaf.bytes; ++r)
      out.references.push_back(
          static_cast<std::byte>(leaf.firstFresh - 1u - std::to_integer<std::uint32_t>(record[r])));
    const Predictor predictor{offset, leaf};
    forEachFresh(leaf, [&](std::uint32_t entry, std::uint32_t vertex) {
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t rest = zigzag(offset[vertex][k] - predictor.predict(entry, vertex, k));
        for (std::uint32_t b = 0; b < 4; ++b)
          out.planes[4 * static_cast<std::uint32_t>(k) + b].push_back(
              static_cast<std::byte>(rest >> (8 * b) & 255u));
      }
    });
  }
  append(out.headers, &h, sizeof(h));
  append(out.attributes, blob.data() + o.normals, o.attributesEnd - o.normals);
  return true;
}

// Headers byte by byte.
Stream transposed(const Stream& in, std::size_t rows, std::size_t columns) {
  Stream out(in.size());
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) out[c * rows + r] = in[r * columns + c];
  return out;
}

}  // namespace

std::vector<std::byte> packClusters(std::span<const std::span<const std::byte>> blobs) {
  std::uint64_t bytes = 0;
  for (const std::span<const std::byte> blob : blobs) bytes += blob.size();
  if (bytes > kMaxPageBytes) throw std::invalid_argument("hccm: a page over 16 MiB");
  Streams streams;
  const bool arranged =
      std::all_of(blobs.begin(), blobs.end(), [&](auto blob) { return takeApart(blob, streams); });
  Stream out;
  appendWord(out, blobs.size());
  appendWord(out, bytes);
  appendWord(out, arranged ? kArranged : kRaw);
  if (arranged) {
    streams.headers = transposed(streams.headers, blobs.size(), sizeof(Header));
    const auto isLow = [&](const Stream& s) {
      const std::ptrdiff_t plane = &s - streams.planes.data();
      return plane >= 0 && plane < 12 && plane % 4 < 2;
    };
    streams.forEach([&](const Stream& s) { writeStream(out, s, !isLow(s)); });
    return out;
  }
  Stream sizes, plain;
  for (const std::span<const std::byte> blob : blobs) {
    appendWord(sizes, blob.size());
    append(plain, blob.data(), blob.size());
  }
  writeStream(out, sizes);
  writeStream(out, plain);
  return out;
}

std::uint64_t packedBytes(const Mesh& mesh) {
  constexpr std::uint32_t kClusters = 96;
  const std::uint32_t pages = (mesh.clusterCount() + kClusters - 1) / kClusters;
  return tbb::parallel_reduce(
      tbb::blocked_range<std::uint32_t>(0, pages), std::uint64_t{0},
      [&](const tbb::blocked_range<std::uint32_t>& range, std::uint64_t sum) {
        for (std::uint32_t p = range.begin(); p < range.end(); ++p) {
          std::vector<std::span<const std::byte>> blobs;
          const std::uint32_t end = std::min((p + 1) * kClusters, mesh.clusterCount());
          for (std::uint32_t c = p * kClusters; c < end; ++c) blobs.push_back(mesh.clusterBytes(c));
          sum += packClusters(blobs).size();
        }
        return sum;
      },
      std::plus<>());
}

}  // namespace hccm
