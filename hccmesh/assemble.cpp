// Blobs from the streams of an arranged page. Compiled once for each instruction set [Highway's
// foreach_target].
#include <algorithm>
#include <bit>
#include <cstring>

#include "hccmesh/layout.h"
#include "hccmesh/page_streams.h"
#include "hccmesh/validate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hccmesh/assemble.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#if HWY_ARCH_X86_64 && !defined(HCCM_X86_INTRINSICS)
#define HCCM_X86_INTRINSICS
#include <immintrin.h>
#endif

HWY_BEFORE_NAMESPACE();
namespace hccm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Header = layout::ClusterHeader;
using DU = hn::FixedTag<std::uint32_t, 4>;
using DB = hn::FixedTag<std::uint8_t, 16>;
using VU = hn::Vec<DU>;

HWY_INLINE std::uint64_t load64(const std::byte* at) {
  std::uint64_t word;
  std::memcpy(&word, at, sizeof(word));
  return word;
}
HWY_INLINE std::uint64_t lowBits(std::uint64_t word, std::uint32_t count) {  // count < 64
  return word & ((std::uint64_t{1} << count) - 1u);
}
/// The low bits of a word, one after the other to where the mask has bits.
HWY_INLINE std::uint64_t spread(std::uint64_t word, std::uint64_t mask) {
#if HWY_TARGET <= HWY_AVX2 && HWY_ARCH_X86_64
  return _pdep_u64(word, mask);
#else
  std::uint64_t out = 0;
  for (; mask != 0; mask &= mask - 1, word >>= 1)
    if (word & 1u) out |= mask & (0u - mask);
  return out;
#endif
}

constexpr std::uint64_t kNibbles = 0x1111111111111111ull, kBytes = 0x0101010101010101ull,
                        kCount = 0xfedcba9876543210ull;

/// A strip: nibbles and bits by entry.
struct Strip {
  std::uint32_t size, starts, locals;
  std::uint32_t fresh;    ///< bits by local number
  std::uint32_t places;   ///< bits by entry: it names a fresh vertex
  std::uint64_t entries;  ///< local numbers
  std::uint32_t bytes;    ///< of its code
};

/// Whether no entry names a local number that none before it has named: `next` has a bit for each
/// that names a new one.
HWY_INLINE bool namesWhatIsNamed(std::uint64_t entries, std::uint64_t next) {
  // The newest number that has been named by then. Of 16 the last wraps around as it should.
  const std::uint64_t newest = spread(next, kNibbles) * kNibbles - kNibbles;
  constexpr std::uint64_t kLow = 0x0f0f0f0f0f0f0f0full, kHigh = 0x8080808080808080ull;
  const std::uint64_t even = ((newest & kLow) | kHigh) - (entries & kLow);
  const std::uint64_t odd = ((newest >> 4 & kLow) | kHigh) - (entries >> 4 & kLow);
  return (even & odd & kHigh) == kHigh;
}

/// Reads a record behind its first byte, up to its references; touches 16 bytes. FORMAT.md,
/// "Records".
HWY_INLINE Strip readStrip(const std::byte* code) {
  const std::uint64_t head = load64(code);
  const std::uint32_t more = head & 15u;
  if (more > layout::kMaxEntries - 3) refusePage("a damaged leaf");
  Strip s;
  s.size = 3 + more;
  s.starts = 1u | static_cast<std::uint32_t>(lowBits(head >> 4, more)) << 1;
  const std::uint64_t next = 7u | lowBits(head >> (4 + more), more) << 3;
  s.locals = static_cast<std::uint32_t>(std::popcount(next));
  s.fresh = static_cast<std::uint32_t>(lowBits(head >> (4 + 2 * more), s.locals));
  s.places = static_cast<std::uint32_t>(spread(s.fresh, next));
  const std::uint32_t oldBit = 4 + 2 * more + s.locals, endBit = oldBit + 4 * (s.size - s.locals);
  s.bytes = (endBit + 7) / 8;
  const std::uint64_t old = load64(code + oldBit / 8) >> (oldBit & 7u);  // 57 bits, at most 52
  const std::uint64_t inStrip = ~std::uint64_t{0} >> (64 - 4 * s.size);
  const std::uint64_t newer = spread(next, kNibbles) * 15;
  s.entries = (spread(kCount, newer) | spread(old, ~newer)) & inStrip;
  const std::uint32_t spare = 8 * s.bytes - endBit;
  if (std::popcount(s.starts) > static_cast<int>(layout::kLeafSize) ||
      s.starts >> (s.size - 3) != 1u || layout::readBits(code, endBit, spare) != 0 ||
      !namesWhatIsNamed(s.entries, next))
    refusePage("a damaged leaf");
  return s;
}

class Assembler {
 public:
  Assembler(Streams& in, bool known, ClusterPage& page)
      : in_(in),
        known_(known),
        page_(page),
        heads_(in.heads.size()),
        references_(in.references.size()),
        vertices_(in.planes[0].size()),
        padded_((vertices_ + 3) / 4 * 4),
        rest_(in.rest) {
    // Whole words are read.
    in.heads.resize(heads_ + 2 * sizeof(std::uint64_t));
    in.references.resize(references_ + layout::kMaxEntries);
    readRest();
  }

  void add(const Header& header) {
    Header h = header;
    if (h.leafCount < 1 || h.leafCount > layout::kMaxLeaves) refusePage("wrong leaf count");
    alignas(16) std::uint32_t shift[4] = {h.boxShift[0], h.boxShift[1], h.boxShift[2], 0};
    const VU boxShift = hn::Load(DU(), shift);
    hn::Store(hn::Set(DU(), ~0u), DU(), least_), hn::Store(hn::Zero(DU()), DU(), most_);
    triangles_ = 0;
    std::uint32_t used = 0, end = 0;
    for (std::uint32_t i = 0; i < h.leafCount; ++i) {
      starts_[i] = end;
      used += addLeaf(i, used, records_ + end, boxShift, end);
    }
    if (used != h.vertices()) refusePage("wrong vertex count");

    h.vertexOffset = static_cast<std::uint16_t>(layout::recordsOf(h) + end);
    const layout::Offsets o = layout::offsetsOf(h);
    if (o.end > page_.bytes.size() - layout::kTailBytes - next_) refusePage("more than it says");
    page_.offsets.push_back(static_cast<std::uint32_t>(next_));
    std::byte* blob = page_.bytes.data() + next_;
    std::memcpy(blob, &h, sizeof(h));
    for (std::uint32_t p = 0; p < 6 && h.leafCount > 1; ++p)
      std::memcpy(blob + o.boxes + p * h.leafCount, boxes_[p], h.leafCount);
    writePlaces(blob, h, o);
    std::memcpy(blob + o.records, records_, end);
    writeVertices(blob + o.vertices, h);
    const std::size_t attributes = o.attributesEnd - o.normals;
    if (attributes > in_.attributes.size() - attribute_) refusePage("too few attributes");
    if (attributes > 0)
      std::memcpy(blob + o.normals, in_.attributes.data() + attribute_, attributes);
    attribute_ += attributes;
    if (!known_) validateAssembled(blob, triangles_, least_, most_, next_);
    next_ += o.end;
  }

  void finish() {
    if (next_ + layout::kTailBytes != page_.bytes.size()) refusePage("less than it says");
    page_.offsets.push_back(static_cast<std::uint32_t>(next_));
  }

 private:
  /// Differences of vertices from what is predicted, four numbers each.
  void readRest() {
    for (Stream& plane : in_.planes) plane.resize(padded_);
    rest_.resize(4 * padded_);
    const DU d;
    const hn::Rebind<std::uint8_t, DU> bytes;
    const auto axis = [&](std::size_t k, std::size_t v) {
      VU word = hn::Zero(d);
      for (std::size_t b = 4; b-- > 0;) {
        const auto* plane = reinterpret_cast<const std::uint8_t*>(in_.planes[4 * k + b].data());
        word = hn::Or(hn::ShiftLeft<8>(word), hn::PromoteTo(d, hn::LoadU(bytes, plane + v)));
      }
      const VU sign = hn::Sub(hn::Zero(d), hn::And(word, hn::Set(d, 1u)));  // zigzag
      return hn::Xor(hn::ShiftRight<1>(word), sign);
    };
    for (std::size_t v = 0; v < vertices_; v += 4)
      hn::StoreInterleaved4(axis(0, v), axis(1, v), axis(2, v), hn::Zero(d), d, &rest_[4 * v]);
  }

  /// Reads a leaf whose cluster has `used` vertices before it. Its record is appended, its fresh
  /// vertices follow the others, and it gets its box. The number of these vertices.
  HWY_INLINE std::uint32_t addLeaf(std::uint32_t leaf, std::uint32_t used, std::byte* record,
                                   VU boxShift, std::uint32_t& end) {
    if (head_ > heads_) refusePage("too few leaves");
    const std::byte* code = in_.heads.data() + head_;
    const Strip s = readStrip(code);
    const auto fresh = static_cast<std::uint32_t>(std::popcount(s.fresh));
    const std::uint32_t old = s.locals - fresh;
    if (old > references_ - reference_) refusePage("too few references");
    if (used + fresh > layout::kMaxVertices) refusePage("too many vertices");
    if (fresh > vertices_ - vertex_) refusePage("too few vertices");

    // References count back from the last vertex.
    const DB db;
    const auto back =
        hn::LoadU(db, reinterpret_cast<const std::uint8_t*>(in_.references.data()) + reference_);
    const auto references = hn::Sub(hn::Set(db, static_cast<std::uint8_t>(used - 1u)), back);
    const auto beyond =
        hn::And(hn::FirstN(db, old), hn::Lt(back, hn::Set(db, static_cast<std::uint8_t>(used))));
    if (hn::CountTrue(db, beyond) != old) refusePage("a damaged leaf");
    record[0] = static_cast<std::byte>(used);
    std::memcpy(record + 1, code, 16);
    hn::StoreU(references, db, reinterpret_cast<std::uint8_t*>(record) + 1 + s.bytes);
    head_ += s.bytes;
    reference_ += old;
    end += 1 + s.bytes + old;
    triangles_ += static_cast<std::uint32_t>(std::popcount(s.starts));

    name(s, used, record + 1 + s.bytes);
    readVertices(s, used);
    writeBox(leaf, s.locals, boxShift);
    return fresh;
  }

  /// Places in offset_ of what local numbers and entries stand for: a vertex is at its number + 1.
  HWY_INLINE void name(const Strip& s, std::uint32_t used, const std::byte* references) {
    const std::uint64_t first = used * kBytes;
    const auto freshCount = static_cast<std::uint32_t>(std::popcount(s.fresh & 255u));
    const std::uint64_t low = spread(s.fresh & 255u, kBytes) * 255;
    const std::uint64_t high = spread(s.fresh >> 8, kBytes) * 255;
    constexpr std::uint64_t kEight = 0x0706050403020100ull;
    std::uint64_t local[2], entry[2];
    local[0] = (spread(kEight, low) + (low & first)) | spread(load64(references), ~low);
    local[1] = (spread(kEight, high) + (high & (first + freshCount * kBytes))) |
               spread(load64(references + 8 - freshCount), ~high);
    constexpr std::uint64_t kLow = 0x0f0f0f0f0f0f0f0full;
    entry[0] = spread(s.entries, kLow), entry[1] = spread(s.entries >> 32, kLow);
    const DB db;
    const auto locals =
        hn::Add(hn::LoadU(db, reinterpret_cast<const std::uint8_t*>(local)), hn::Set(db, 1));
    const auto entries = hn::LoadU(db, reinterpret_cast<const std::uint8_t*>(entry));
    hn::StoreU(locals, db, locals_);
    hn::StoreU(hn::TableLookupBytes(locals, entries), db, entries_ + 3);
    entries_[2] = static_cast<std::uint8_t>(used);  // before the first entry: the vertex before
  }

  HWY_INLINE void readVertices(const Strip& s, std::uint32_t used) {
    const DU d;
    const VU most = hn::Set(d, (1u << layout::kMaxWidth) - 1u);
    const std::uint32_t inside = parallelograms(s.starts);
    std::uint32_t* to = offset_[used + 1];
    for (std::uint32_t left = s.places; left != 0; left &= left - 1, to += 4, ++vertex_) {
      const auto e = static_cast<std::uint32_t>(std::countr_zero(left));
      const std::uint8_t* place = entries_ + e;  // of the entry three before
      const std::uint8_t third = place[0], second = (inside >> e & 1u) ? place[1] : third;
      const VU predicted =
          hn::Sub(hn::Add(hn::Load(d, offset_[place[2]]), hn::Load(d, offset_[second])),
                  hn::Load(d, offset_[third]));
      hn::Store(hn::And(hn::Add(predicted, hn::LoadU(d, &rest_[4 * vertex_])), most), d, to);
    }
  }

  /// As leafBox().
  HWY_INLINE void writeBox(std::uint32_t leaf, std::uint32_t locals, VU shift) {
    const DU d;
    VU lower = hn::Load(d, offset_[locals_[0]]), upper = lower;
    for (std::uint32_t i = 1; i < locals; ++i) {
      const VU at = hn::Load(d, offset_[locals_[i]]);
      lower = hn::Min(lower, at), upper = hn::Max(upper, at);
    }
    hn::Store(hn::Min(lower, hn::Load(d, least_)), d, least_);
    hn::Store(hn::Max(upper, hn::Load(d, most_)), d, most_);
    const VU one = hn::Set(d, 1u), round = hn::Sub(hn::Shl(one, shift), one);
    alignas(16) std::uint32_t from[4], to[4];
    hn::Store(hn::Shr(lower, shift), d, from);
    hn::Store(hn::Shr(hn::Add(upper, round), shift), d, to);
    for (std::size_t k = 0; k < 3; ++k) {
      boxes_[2 * k][leaf] = static_cast<std::uint8_t>(from[k]);
      boxes_[2 * k + 1][leaf] = static_cast<std::uint8_t>(to[k]);
    }
  }

  void writePlaces(std::byte* blob, const Header& h, const layout::Offsets& o) const {
    for (std::uint32_t i = 0; i < h.leafCount; ++i) {
      const std::uint32_t group = starts_[i / 8 * 8];
      if (i % 8 == 0) {
        const auto at = static_cast<std::uint16_t>(o.records + group);
        std::memcpy(blob + o.groupStarts + i / 8 * 2, &at, sizeof(at));
      }
      blob[o.leafStarts + i] = static_cast<std::byte>(starts_[i] - group);
    }
  }

  /// The bits of three numbers after those of the ones before; touches 8 bytes behind the last.
  void writeVertices(std::byte* stream, const Header& h) const {
    std::uint32_t width[3], mask[3];
    for (int k = 0; k < 3; ++k) {
      width[k] = std::min<std::uint32_t>(h.width[k], layout::kMaxWidth);
      mask[k] = (1u << width[k]) - 1u;
    }
    const std::uint32_t bits = h.vertexBits();
    if (bits > 56) return writeWideVertices(stream, h);
    std::uint64_t word = 0;
    std::uint32_t filled = 0;
    for (std::uint32_t v = 1; v <= h.vertices(); ++v) {
      const std::uint32_t* at = offset_[v];
      const std::uint64_t packed = std::uint64_t{at[0] & mask[0]} |
                                   std::uint64_t{at[1] & mask[1]} << width[0] |
                                   std::uint64_t{at[2] & mask[2]} << (width[0] + width[1]);
      word |= packed << filled;
      std::memcpy(stream, &word, sizeof(word));
      filled += bits;
      stream += filled / 8;
      word >>= filled & ~7u;
      filled &= 7u;
    }
  }
  void writeWideVertices(std::byte* stream, const Header& h) const {
    std::uint32_t bit = 0;
    for (std::uint32_t v = 1; v <= h.vertices(); ++v)
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t mask = (1u << h.width[k]) - 1u;
        layout::writeBits(stream, bit, h.width[k], offset_[v][k] & mask);
        bit += h.width[k];
      }
  }

  Streams& in_;
  const bool known_;
  ClusterPage& page_;
  std::uint64_t next_ = 0;  ///< where the next blob starts
  std::size_t head_ = 0, reference_ = 0, vertex_ = 0, attribute_ = 0;  ///< read so far
  std::size_t heads_, references_, vertices_;                          ///< there are
  std::size_t padded_;                                                 ///< vertices, in fours
  std::vector<std::uint32_t>& rest_;                                   ///< four numbers of a vertex
  // Of the cluster that is being put together; vertices from 1 on, before them one at 0.
  alignas(16) std::uint32_t offset_[layout::kMaxVertices + 1][4] = {};
  alignas(16) std::uint32_t least_[4], most_[4];  ///< of these
  std::uint32_t triangles_ = 0;
  std::uint32_t starts_[layout::kMaxLeaves];
  std::uint8_t boxes_[6][layout::kMaxLeaves];
  std::byte records_[layout::kMaxLeaves * layout::kMaxRecord + 32];
  // Of the leaf, places in offset_: by local number; by entry, from 3 on.
  std::uint8_t locals_[16], entries_[3 + 16] = {};
};

void assemble(Streams& streams, std::span<const Header> headers, bool known, ClusterPage& page) {
  Assembler out(streams, known, page);
  for (const Header& h : headers) out.add(h);
  out.finish();
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hccm {
HWY_EXPORT(assemble);
void assembleClusters(Streams& streams, std::span<const layout::ClusterHeader> headers, bool known,
                      ClusterPage& page) {
  HWY_DYNAMIC_DISPATCH(assemble)(streams, headers, known, page);
}
}  // namespace hccm
#endif
