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
#include <memory>

#include "hccmesh/boxes.h"
#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"
#include "hccmesh/validate.h"

namespace hccm {
namespace {

using Stream = std::vector<std::byte>;
using Header = layout::ClusterHeader;

constexpr int kLevel = 3;
constexpr std::size_t kHeadBytes = 12;
constexpr std::uint32_t kRaw = 0, kArranged = 1;

[[noreturn]] void refuse(const char* what) {
  throw FormatError(std::string("not a valid page of clusters: ") + what);
}

std::uint32_t wordAt(std::span<const std::byte> bytes, std::size_t at) {
  if (bytes.size() < at + 4) refuse("truncated");
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

void append(Stream& out, const void* from, std::size_t bytes) {
  const std::size_t start = out.size();
  out.resize(start + bytes);
  if (bytes > 0) std::memcpy(out.data() + start, from, bytes);
}
void appendWord(Stream& out, std::size_t value) {
  const auto word = static_cast<std::uint32_t>(value);
  append(out, &word, sizeof(word));
}

void writeStream(Stream& out, const Stream& plain) {
  const std::size_t head = out.size();
  appendWord(out, plain.size());
  appendWord(out, 0);
  const std::size_t start = out.size();
  out.resize(start + ZSTD_compressBound(plain.size()));
  const std::size_t size = ZSTD_compressCCtx(compressor(), out.data() + start, out.size() - start,
                                             plain.data(), plain.size(), kLevel);
  if (ZSTD_isError(size)) throw std::bad_alloc();
  out.resize(start + size);
  const auto word = static_cast<std::uint32_t>(size);
  std::memcpy(out.data() + head + 4, &word, sizeof(word));
}

// The next stream of a page; `at` moves on. Not over `most` bytes.
Stream readStream(std::span<const std::byte> packed, std::size_t& at, std::uint64_t most) {
  const std::uint32_t plain = wordAt(packed, at), size = wordAt(packed, at + 4);
  at += 8;
  if (plain > most || size > packed.size() - at) refuse("a stream of wrong size");
  Stream out(plain);
  const std::size_t done =
      ZSTD_decompressDCtx(decompressor(), out.data(), plain, packed.data() + at, size);
  if (ZSTD_isError(done) || done != plain) refuse("damaged data");
  at += size;
  return out;
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
    const bool inside = entry >= 3 && (leaf.starts >> (entry - 3) & 3u) == 3u;
    return inside ? at(entry - 1, axis) + at(entry - 2, axis) - at(entry - 3, axis)
                  : at(entry - 1, axis);
  }
};

std::uint32_t zigzag(std::int32_t v) {
  return static_cast<std::uint32_t>(v) << 1 ^ static_cast<std::uint32_t>(v >> 31);
}
std::int32_t unzigzag(std::uint32_t v) {
  return static_cast<std::int32_t>(v >> 1 ^ (0u - (v & 1u)));
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

struct Streams {
  Stream headers, heads, references, attributes;
  std::array<Stream, 12> planes;

  template <typename Each>
  void forEach(const Each& each) {
    for (Stream* s : {&headers, &heads, &references, &attributes}) each(*s);
    for (Stream& s : planes) each(s);
  }
};

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

// Headers byte by byte, or back.
Stream transposed(const Stream& in, std::size_t rows, std::size_t columns) {
  Stream out(in.size());
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) out[c * rows + r] = in[r * columns + c];
  return out;
}

// Puts blobs together again.
class Assembler {
 public:
  Assembler(Streams& streams, std::uint64_t bytes, bool known) : in_(streams), known_(known) {
    page_.bytes.resize(bytes + layout::kTailBytes);
    // A record is read in words.
    in_.heads.resize(in_.heads.size() + layout::kMaxRecord + 8);
  }

  void add(const Header& header) {
    Header h = header;
    std::array<std::byte, layout::kMaxLeaves*(layout::kMaxRecord + 8)> records{};
    std::uint32_t used = 0, end = 0;
    if (h.leafCount < 1 || h.leafCount > layout::kMaxLeaves) refuse("wrong leaf count");
    for (std::uint32_t i = 0; i < h.leafCount; ++i) {
      starts_[i] = end;
      leaves_[i] = readRecord(records.data() + end, used);
      used += leaves_[i].fresh;
      end += leaves_[i].bytes;
    }
    if (used != h.vertices()) refuse("wrong vertex count");
    for (std::uint32_t i = 0; i < h.leafCount; ++i) readVertices(leaves_[i]);

    h.vertexOffset = static_cast<std::uint16_t>(layout::recordsOf(h) + end);
    const layout::Offsets o = layout::offsetsOf(h);
    const std::uint64_t start = page_.offsets.empty() ? 0 : next_;
    if (o.end > page_.bytes.size() - layout::kTailBytes - start) refuse("more than it says");
    page_.offsets.push_back(static_cast<std::uint32_t>(start));
    next_ = start + o.end;
    std::byte* blob = page_.bytes.data() + start;
    std::memcpy(blob, &h, sizeof(h));
    std::memcpy(blob + o.records, records.data(), end);
    for (std::uint32_t i = 0; i < h.leafCount; ++i) writeLeaf(blob, h, o, i);
    writeVertices(blob + o.vertices, h);
    if (o.attributesEnd - o.normals > in_.attributes.size() - attribute_)
      refuse("too few attributes");
    std::copy_n(in_.attributes.begin() + static_cast<std::ptrdiff_t>(attribute_),
                o.attributesEnd - o.normals, blob + o.normals);
    attribute_ += o.attributesEnd - o.normals;
    if (!known_) validateCluster(std::span(page_.bytes).subspan(start, o.end), start);
  }

  ClusterPage finish() {
    if (next_ + layout::kTailBytes != page_.bytes.size()) refuse("less than it says");
    page_.offsets.push_back(static_cast<std::uint32_t>(next_));
    return std::move(page_);
  }

 private:
  LeafTopology readRecord(std::byte* record, std::uint32_t used) {
    if (head_ + layout::kMaxRecord + 8 > in_.heads.size()) refuse("too few leaves");
    if (used > 255) refuse("too many vertices");
    record[0] = static_cast<std::byte>(used);
    std::memcpy(record + 1, in_.heads.data() + head_, layout::kMaxRecord - 1);
    const LeafTopology leaf = readLeaf(record);
    head_ += leaf.headBytes - 1;
    const std::uint32_t count = leaf.bytes - leaf.headBytes;
    if (leaf.bytes > layout::kMaxRecord || count > in_.references.size() - reference_)
      refuse("too few references");
    for (std::uint32_t i = 0; i < count; ++i)
      record[leaf.headBytes + i] = static_cast<std::byte>(
          used - 1u - std::to_integer<std::uint32_t>(in_.references[reference_++]));
    std::fill(record + leaf.bytes, record + layout::kMaxRecord + 8, std::byte{0});
    const LeafTopology whole = readLeaf(record);
    if (!whole.canonical || used + whole.fresh > layout::kMaxVertices) refuse("a damaged leaf");
    return whole;
  }

  void readVertices(const LeafTopology& leaf) {
    if (leaf.fresh > in_.planes[0].size() - vertex_) refuse("too few vertices");
    const Predictor predictor{offset_, leaf};
    forEachFresh(leaf, [&](std::uint32_t entry, std::uint32_t vertex) {
      for (std::uint32_t k = 0; k < 3; ++k) {
        std::uint32_t rest = 0;
        for (std::uint32_t b = 0; b < 4; ++b)
          rest |= std::to_integer<std::uint32_t>(in_.planes[4 * k + b][vertex_]) << (8 * b);
        const int axis = static_cast<int>(k);
        // Unsigned: damaged data may overflow.
        const auto sum = static_cast<std::uint32_t>(unzigzag(rest)) +
                         static_cast<std::uint32_t>(predictor.predict(entry, vertex, axis));
        offset_[vertex][k] = static_cast<std::int32_t>(sum & ((1u << layout::kMaxWidth) - 1u));
      }
      ++vertex_;
    });
  }

  void writeLeaf(std::byte* blob, const Header& h, const layout::Offsets& o,
                 std::uint32_t i) const {
    if (h.leafCount > 1) {
      std::uint8_t planes[6];
      leafBox(leaves_[i], offset_, h.boxShift, planes);
      for (std::uint32_t p = 0; p < 6; ++p)
        blob[o.boxes + p * h.leafCount + i] = static_cast<std::byte>(planes[p]);
    }
    const std::uint32_t group = starts_[i / 8 * 8];
    if (i % 8 == 0) {
      const auto at = static_cast<std::uint16_t>(o.records + group);
      std::memcpy(blob + o.groupStarts + i / 8 * 2, &at, sizeof(at));
    }
    blob[o.leafStarts + i] = static_cast<std::byte>(starts_[i] - group);
  }

  void writeVertices(std::byte* stream, const Header& h) const {
    std::uint32_t bit = 0;
    for (std::uint32_t v = 0; v < h.vertices(); ++v)
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t width = std::min<std::uint32_t>(h.width[k], layout::kMaxWidth);
        const auto value = static_cast<std::uint32_t>(offset_[v][k]) & ((1u << width) - 1u);
        layout::writeBits(stream, bit, width, value);
        bit += width;
      }
  }

  Streams& in_;
  const bool known_;
  ClusterPage page_;
  std::uint64_t next_ = 0;
  std::size_t head_ = 0, reference_ = 0, vertex_ = 0, attribute_ = 0;
  std::array<LeafTopology, layout::kMaxLeaves> leaves_;
  std::array<std::uint32_t, layout::kMaxLeaves> starts_{};
  std::int32_t offset_[layout::kMaxVertices][3] = {};
};

ClusterPage assemble(std::span<const std::byte> packed, std::uint32_t count, std::uint64_t bytes,
                     bool known) {
  std::size_t at = kHeadBytes;
  Streams streams;
  streams.forEach([&](Stream& s) { s = readStream(packed, at, bytes); });
  if (at != packed.size()) refuse("bytes behind the last stream");
  if (streams.headers.size() != count * sizeof(Header)) refuse("wrong number of headers");
  for (const Stream& plane : streams.planes)
    if (plane.size() != streams.planes[0].size()) refuse("planes of different sizes");
  const Stream headers = transposed(streams.headers, sizeof(Header), count);
  Assembler out(streams, bytes, known);
  for (std::uint32_t i = 0; i < count; ++i) {
    Header h;
    std::memcpy(&h, headers.data() + i * sizeof(h), sizeof(h));
    for (std::uint8_t width : h.width)
      if (width > layout::kMaxWidth) refuse("wrong width");
    for (std::uint8_t shift : h.boxShift)
      if (shift > 24) refuse("wrong box shift");
    out.add(h);
  }
  return out.finish();
}

ClusterPage copy(std::span<const std::byte> packed, std::uint32_t count, std::uint64_t bytes,
                 bool known) {
  std::size_t at = kHeadBytes;
  const Stream sizes = readStream(packed, at, std::uint64_t{4} * count);
  ClusterPage page;
  page.bytes = readStream(packed, at, bytes);
  if (at != packed.size() || sizes.size() != std::size_t{4} * count || page.bytes.size() != bytes)
    refuse("streams of wrong size");
  page.bytes.resize(bytes + layout::kTailBytes);
  std::uint64_t start = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    page.offsets.push_back(static_cast<std::uint32_t>(start));
    const std::uint64_t size = wordAt(sizes, std::size_t{4} * i);
    if (size > bytes - start) refuse("a cluster ends outside");
    if (!known) validateCluster(std::span(page.bytes).subspan(start, size), start);
    start += size;
  }
  if (start != bytes) refuse("bytes behind the last cluster");
  page.offsets.push_back(static_cast<std::uint32_t>(start));
  return page;
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
    streams.forEach([&](const Stream& s) { writeStream(out, s); });
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

std::uint64_t unpackedBytes(std::span<const std::byte> packed) {
  const std::uint32_t bytes = wordAt(packed, 4);
  if (bytes > kMaxPageBytes) refuse("over 16 MiB");
  return bytes + layout::kTailBytes;
}

ClusterPage unpackClusters(std::span<const std::byte> packed, bool known) {
  const std::uint64_t bytes = unpackedBytes(packed) - layout::kTailBytes;
  const std::uint32_t count = wordAt(packed, 0), mode = wordAt(packed, 8);
  if (count > bytes / sizeof(Header)) refuse("too many clusters");
  if (mode > kArranged) refuse("unknown mode");
  return mode == kRaw ? copy(packed, count, bytes, known) : assemble(packed, count, bytes, known);
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
