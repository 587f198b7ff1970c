// One ray against one cluster: boxes of 8 leaves at once, then 8 triangles at once. Compiled once
// for each instruction set [Highway's foreach_target].
#include "hccmesh/trace.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hccmesh/trace.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "hccmesh/trace-inl.h"
#if HWY_ARCH_X86_64 && !defined(HCCM_X86_INTRINSICS)
#define HCCM_X86_INTRINSICS
#include <immintrin.h>
#endif

HWY_BEFORE_NAMESPACE();
namespace hccm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// What all leaves of a cluster share; axes in the order asked for, a ray's kx, ky, kz.
struct Cluster {
  const std::uint8_t* vertices;
  std::uint32_t vertexBits, widthXy;
  std::uint32_t shift[3], mask[3];
  std::int32_t anchor[3];  // as seen from the cell
};

HWY_INLINE Cluster openCluster(const std::uint8_t* blob, const layout::ClusterHeader& h,
                               const std::int32_t* axis, const std::int32_t* cell) {
  Cluster c;
  c.vertices = blob + h.vertexOffset;
  const std::uint32_t shifts[3] = {0u, h.width[0], std::uint32_t(h.width[0]) + h.width[1]};
  c.vertexBits = h.vertexBits();
  c.widthXy = shifts[2];
  for (int i = 0; i < 3; ++i) {
    const int k = axis[i];
    c.shift[i] = shifts[k];
    c.mask[i] = (1u << h.width[k]) - 1u;
    c.anchor[i] = h.lower[k] - cell[k];
  }
  return c;
}

// The 64 bits of a stream from bit `bit` on, for each lane; 57 of them are good. In one vector
// where registers are wide enough, else in two.
#if HWY_TARGET <= HWY_AVX3
using DQ = hn::Rebind<std::uint64_t, DU>;
struct Words {
  hn::Vec<DQ> all;
};
HWY_INLINE Words fetchWords(const std::uint8_t* base, VU bit) {
  const DU du;
  const DQ dq;
  const hn::RebindToSigned<DQ> ds;
  const auto byte = hn::BitCast(ds, hn::PromoteTo(dq, hn::ShiftRight<3>(bit)));
  const auto word = hn::GatherOffset(dq, reinterpret_cast<const std::uint64_t*>(base), byte);
  return {hn::Shr(word, hn::PromoteTo(dq, hn::And(bit, hn::Set(du, 7u))))};
}
HWY_INLINE VU lowHalves(const Words& w, std::uint32_t shift) {
  return hn::TruncateTo(DU(), hn::ShiftRightSame(w.all, static_cast<int>(shift)));
}
#else
using DUHalf = hn::Half<DU>;
using DQ = hn::Rebind<std::uint64_t, DUHalf>;
struct Words {
  hn::Vec<DQ> low, high;
};
// One load each: gathers are slower, and so is a vector load of words that were just stored.
HWY_INLINE hn::Vec<DQ> load64s(const std::uint8_t* base, const std::uint32_t* offset) {
  const auto at = [&](std::size_t i) {
    long long word;
    std::memcpy(&word, base + offset[i], sizeof(word));
    return word;
  };
#if HWY_TARGET <= HWY_AVX2 && HWY_ARCH_X86_64
  return hn::Vec<DQ>{_mm256_set_epi64x(at(3), at(2), at(1), at(0))};
#elif HWY_ARCH_X86_64
  return hn::Vec<DQ>{_mm_set_epi64x(at(1), at(0))};
#else
  alignas(16) std::uint64_t words[hn::MaxLanes(DQ())];
  for (std::size_t i = 0; i < hn::MaxLanes(DQ()); ++i) words[i] = static_cast<std::uint64_t>(at(i));
  return hn::Load(DQ(), words);
#endif
}
HWY_INLINE Words fetchWords(const std::uint8_t* base, VU bit) {
  const DU du;
  const DUHalf dh;
  const DQ dq;
  alignas(32) std::uint32_t byte[kLanes];
  hn::Store(hn::ShiftRight<3>(bit), du, byte);
  const VU shift = hn::And(bit, hn::Set(du, 7u));
  return {hn::Shr(load64s(base, byte), hn::PromoteTo(dq, hn::LowerHalf(dh, shift))),
          hn::Shr(load64s(base, byte + kLanes / 2), hn::PromoteTo(dq, hn::UpperHalf(dh, shift)))};
}
HWY_INLINE VU lowHalves(const Words& w, std::uint32_t shift) {
  const DU du;
  const int bits = static_cast<int>(shift);
  return hn::ConcatEven(du, hn::BitCast(du, hn::ShiftRightSame(w.high, bits)),
                        hn::BitCast(du, hn::ShiftRightSame(w.low, bits)));
}
#endif

// The offsets of vertices from the cluster's anchor, in the order of `c`; `last` is the place of z.
HWY_INLINE void decodeOffsets(const Cluster& c, VU index, int last, VU (&offset)[3]) {
  const DU du;
  const VU bit = hn::Mul(index, hn::Set(du, c.vertexBits));
  const Words words = fetchWords(c.vertices, bit);
  for (int i = 0; i < 3; ++i) offset[i] = lowHalves(words, c.shift[i]);
  if (HWY_UNLIKELY(c.vertexBits > 57)) {  // x and y fit in one word, z in the next
    const Words zWords = fetchWords(c.vertices, hn::Add(bit, hn::Set(du, c.widthXy)));
    for (int i = 0; i < 3; ++i)
      if (i == last) offset[i] = lowHalves(zWords, 0);
  }
  for (int i = 0; i < 3; ++i) offset[i] = hn::And(offset[i], hn::Set(du, c.mask[i]));
}

// Exact integers and the ray's own origin, rounded to what single precision has of their distance,
// then operations on these alone: equal vertices of two clusters give equal bits.
HWY_INLINE Vertex decodeVertex(const Cluster& c, const PreparedRay& ray, VU index) {
  const DF df;
  const DI di;
  VU offset[3];
  decodeOffsets(c, index, ray.axis[0] == 2 ? 0 : ray.axis[1] == 2 ? 1 : 2, offset);
  VF p[3];
  for (int i = 0; i < 3; ++i) {
    const auto grid = hn::Add(hn::BitCast(di, offset[i]), hn::Set(di, c.anchor[i]));
    p[i] = hn::Sub(hn::ConvertTo(df, grid), hn::Set(df, ray.origin[ray.axis[i]]));
  }
  return shearVertex(p, ray);
}

// A leaf's record, as bytes and nibbles in words.
struct LeafCode {
  std::uint64_t vertex[2];  // of the cluster, a byte for each local number; 0 where there is none
  std::uint32_t corner[3];  // local numbers, a nibble for each triangle
  std::uint32_t locals, triangles;
};

#if HWY_TARGET <= HWY_AVX2 && HWY_ARCH_X86_64
HWY_INLINE std::uint64_t load64(const std::uint8_t* at) {
  std::uint64_t word;
  std::memcpy(&word, at, sizeof(word));
  return word;
}
// readLeaf() without loops: bits are spread over nibbles or bytes, which select what goes there.
HWY_INLINE LeafCode decodeLeaf(const std::uint8_t* record) {
  constexpr std::uint64_t kNibbles = 0x1111111111111111ull, kBytes = 0x0101010101010101ull;
  const std::uint64_t head = load64(record);
  const auto more = static_cast<std::uint32_t>(head >> 8) & 15u;
  const std::uint64_t starts = 1u | _bzhi_u64(head >> 12, more) << 1;
  const std::uint64_t next = 7u | _bzhi_u64(head >> (12 + more), more) << 3;
  LeafCode c;
  c.locals = static_cast<std::uint32_t>(std::popcount(next));
  c.triangles = static_cast<std::uint32_t>(std::popcount(starts));
  const std::uint64_t fresh = _bzhi_u64(head >> (12 + 2 * more), c.locals);
  const std::uint32_t oldBit = 12 + 2 * more + c.locals;
  const std::uint64_t old = load64(record + oldBit / 8) >> (oldBit & 7u);
  const std::uint8_t* refs = record + (oldBit + 4 * (3 + more - c.locals) + 7) / 8;

  const std::uint64_t nextMask = _pdep_u64(next, kNibbles) * 15;
  const std::uint64_t entries =
      _pdep_u64(0xfedcba9876543210ull, nextMask) | _pdep_u64(old, ~nextMask);
  const std::uint64_t startMask = _pdep_u64(starts, kNibbles) * 15;
  const auto nibbles = [&](std::uint64_t from) {
    return static_cast<std::uint32_t>(_pext_u64(from, startMask));
  };
  const std::uint32_t first = nibbles(entries), second = nibbles(entries >> 4);
  const std::uint32_t swap =
      (first ^ second) & nibbles(0xf0f0f0f0f0f0f0f0ull);  // odd starts turn the other way
  c.corner[0] = first ^ swap;
  c.corner[1] = second ^ swap;
  c.corner[2] = nibbles(entries >> 8);

  const std::uint64_t firstFresh = (head & 255u) * kBytes;
  const std::uint64_t low = _pdep_u64(fresh, kBytes) * 255;
  c.vertex[0] =
      (_pdep_u64(0x0706050403020100ull, low) + (low & firstFresh)) | _pdep_u64(load64(refs), ~low);
  c.vertex[0] = _bzhi_u64(c.vertex[0], 8 * c.locals);
  c.vertex[1] = 0;
  if (c.locals > 8) {
    const auto count = static_cast<std::uint32_t>(std::popcount(fresh & 255u));
    const std::uint64_t high = _pdep_u64(fresh >> 8, kBytes) * 255;
    c.vertex[1] =
        (_pdep_u64(0x0706050403020100ull, high) + (high & (firstFresh + count * kBytes))) |
        _pdep_u64(load64(refs + 8 - count), ~high);
    c.vertex[1] = _bzhi_u64(c.vertex[1], 8 * (c.locals - 8));
  }
  return c;
}
#else
HWY_INLINE LeafCode decodeLeaf(const std::uint8_t* record) {
  const LeafTopology leaf = readLeaf(reinterpret_cast<const std::byte*>(record));
  LeafCode c;
  std::memcpy(c.vertex, leaf.vertex, sizeof(c.vertex));
  c.locals = leaf.locals;
  c.triangles = leaf.triangles;
  for (int k = 0; k < 3; ++k) {
    c.corner[k] = 0;
    for (std::uint32_t lane = 0; lane < 8; ++lane)
      c.corner[k] |= std::uint32_t(leaf.corner[k][lane]) << (4 * lane);
  }
  return c;
}
#endif

HWY_INLINE void cornersOf(const LeafCode& leaf, std::uint32_t place, std::uint32_t* vertex) {
  const auto* of = reinterpret_cast<const std::uint8_t*>(leaf.vertex);
  for (int k = 0; k < 3; ++k) vertex[k] = of[leaf.corner[k] >> (4 * place) & 15u];
}

// The vertices of a leaf, by local number.
class LocalVertices {
 public:
  // decode(numbers of the cluster's vertices) gives those of kLanes.
  template <typename Decode>
  HWY_INLINE LocalVertices(const LeafCode& leaf, const Decode& decode) {
    const DU du;
    const DB db;
    const auto* numbers = reinterpret_cast<const std::uint8_t*>(leaf.vertex);
    for (std::size_t i = 0; i < kMost && i * kLanes < leaf.locals; ++i)
      set(i, decode(hn::PromoteTo(du, hn::LoadU(db, numbers + i * kLanes))));
    wide_ = leaf.locals > kLanes;
  }
  // Those of kLanes triangles from `first`.
  HWY_INLINE Corners corners(const LeafCode& leaf, std::uint32_t first) const {
    const DU du;
    const VU shift = hn::ShiftLeft<2>(hn::Iota(du, first));
    Corners c;
    for (int k = 0; k < 3; ++k) {
      const VU number = hn::And(hn::Shr(hn::Set(du, leaf.corner[k]), shift), hn::Set(du, 15u));
      c.x[k] = at(x_, number), c.y[k] = at(y_, number), c.depth[k] = at(depth_, number);
    }
    return c;
  }

 private:
  static constexpr std::size_t kMost = layout::kMaxEntries / kLanes;
#if HWY_TARGET <= HWY_AVX2
  HWY_INLINE void set(std::size_t i, const Vertex& v) {
    x_[i] = v.x, y_[i] = v.y, depth_[i] = v.depth;
  }
  HWY_INLINE VF at(const VF* table, VU number) const {
    const DF df;
    const DU du;
    const auto lane = hn::IndicesFromVec(df, hn::And(number, hn::Set(du, 7u)));
    const VF low = hn::TableLookupLanes(table[0], lane);
    if (!wide_) return low;
    const VF high = hn::TableLookupLanes(table[1], lane);
    return hn::IfNegativeThenElse(hn::BitCast(df, hn::ShiftLeft<28>(number)), high, low);
  }
  VF x_[kMost], y_[kMost], depth_[kMost];
#else
  HWY_INLINE void set(std::size_t i, const Vertex& v) {
    const DF df;
    hn::Store(v.x, df, x_ + i * kLanes);
    hn::Store(v.y, df, y_ + i * kLanes);
    hn::Store(v.depth, df, depth_ + i * kLanes);
  }
  HWY_INLINE VF at(const float* table, VU number) const {
    return hn::GatherIndex(DF(), table, hn::BitCast(DI(), number));
  }
  alignas(32) float x_[layout::kMaxEntries] = {}, y_[layout::kMaxEntries] = {},
                    depth_[layout::kMaxEntries] = {};
#endif
  bool wide_;
};

// The triangles of a leaf for the second look.
struct Leaf {
  const layout::ClusterHeader* header;
  const std::byte* vertices;
  const LeafCode* code;
  std::uint32_t number, cluster, ends;

  HWY_INLINE void readCorners(std::uint32_t place, glm::dvec3 (&p)[3]) const {
    std::uint32_t corner[3];
    cornersOf(*code, place, corner);
    for (int i = 0; i < 3; ++i) {
      std::int32_t grid[3];
      layout::readVertex(vertices, *header, corner[i], grid);
      p[i] = glm::dvec3(grid[0], grid[1], grid[2]);
    }
  }
};

template <bool kAny>
HWY_INLINE bool testLeaf(const Cluster& c, const layout::ClusterHeader& h,
                         const std::uint8_t* record, std::uint32_t number, std::uint32_t cluster,
                         PreparedRay& ray, Hit& hit) {
  const LeafCode code = decodeLeaf(record);
  const LocalVertices vertices(code, [&](VU index) { return decodeVertex(c, ray, index); });
  const Leaf leaf{&h,      reinterpret_cast<const std::byte*>(c.vertices),
                  &code,   number,
                  cluster, endsOn(ray, cluster, number)};
  bool found = false;
  for (std::uint32_t first = 0; first < code.triangles && !(kAny && found); first += kLanes)
    found |= testTriangles<kAny>(leaf, vertices.corners(code, first),
                                 hn::FirstN(DF(), code.triangles - first), first, ray, hit);
  return found;
}

// A ray in the frame of quantised boxes: it meets the plane q at q * scale + near, or far.
struct BoxFrame {
  VF scale, nearOffset, farOffset;  // axes in each block of four lanes
  const std::uint8_t* nearPlanes[3];
  const std::uint8_t* farPlanes[3];
};

// `planes` has lower and upper ones of each axis in turn, `stride` bytes each; 2^(exponents - 127)
// cells are between two. Reads a fourth of `lower`, which is of no meaning.
HWY_INLINE BoxFrame openBoxes(const std::uint8_t* planes, std::uint32_t stride,
                              const std::int32_t* lower, std::uint32_t exponents,
                              const BoxRay& ray) {
  const DF df;
  const DU du;
  alignas(16) static constexpr std::uint32_t kPlaces[4] = {23, 15, 7, 0};
  const VU bits = hn::And(hn::Shl(hn::Set(du, exponents), hn::LoadDup128(du, kPlaces)),
                          hn::Set(du, 0x7f800000u));
  const VF cell = hn::BitCast(df, bits);
  const VF base = hn::ConvertTo(df, hn::LoadDup128(DI(), lower));
  BoxFrame f;
  f.scale = hn::Mul(cell, ray.inverse);
  f.nearOffset = hn::MulSub(base, ray.inverse, ray.nearOffset);
  f.farOffset = hn::MulSub(base, ray.inverse, ray.farOffset);
  for (int k = 0; k < 3; ++k) {
    f.nearPlanes[k] = planes + ray.nearPlane[k] * stride;
    f.farPlanes[k] = planes + (ray.nearPlane[k] ^ 1u) * stride;
  }
  return f;
}

template <int kAxis>
HWY_INLINE VF planes(const std::uint8_t* at, VF scale, VF offset) {
  const DB db;
  const VF q = hn::ConvertTo(DF(), hn::PromoteTo(DI(), hn::LoadU(db, at)));
  return hn::MulAdd(q, hn::Broadcast<kAxis>(scale), hn::Broadcast<kAxis>(offset));
}

// Which of kLanes boxes at byte `at` of the planes are met before `end`; where goes to `entry`.
HWY_INLINE std::uint32_t testBoxes(const BoxFrame& f, std::size_t at, VF start, VF end,
                                   float* entry) {
  const VF x = planes<0>(f.nearPlanes[0] + at, f.scale, f.nearOffset),
           y = planes<1>(f.nearPlanes[1] + at, f.scale, f.nearOffset),
           z = planes<2>(f.nearPlanes[2] + at, f.scale, f.nearOffset);
  const VF farX = planes<0>(f.farPlanes[0] + at, f.scale, f.farOffset),
           farY = planes<1>(f.farPlanes[1] + at, f.scale, f.farOffset),
           farZ = planes<2>(f.farPlanes[2] + at, f.scale, f.farOffset);
  return boxesMet(hn::Max(hn::Max(x, y), hn::Max(z, start)),
                  hn::Min(hn::Min(farX, farY), hn::Min(farZ, end)), entry);
}

// The leaf whose box is entered first.
HWY_INLINE std::uint32_t nearestOf(std::uint64_t met, const float* entry) {
  auto leaf = static_cast<std::uint32_t>(std::countr_zero(met));
  for (std::uint64_t rest = met & (met - 1); rest != 0; rest &= rest - 1) {
    const auto other = static_cast<std::uint32_t>(std::countr_zero(rest));
    if (entry[other] < entry[leaf]) leaf = other;
  }
  return leaf;
}

template <bool kAny>
HWY_INLINE bool testLeaves(const std::byte* bytes, const BoxRay& boxes, PreparedRay& ray,
                           std::uint32_t cluster, Hit& hit) {
  const std::uint8_t* blob = reinterpret_cast<const std::uint8_t*>(bytes);
  const layout::ClusterHeader& h = *reinterpret_cast<const layout::ClusterHeader*>(blob);
  const std::uint32_t leaves = h.leafCount;
  const std::uint8_t* groupStarts = blob + sizeof(layout::ClusterHeader);
  if (leaves == 1) {
    const Cluster c = openCluster(blob, h, ray.axis, ray.cell);
    return testLeaf<kAny>(c, h, blob + layout::recordOffset(bytes, h, 0), 0, cluster, ray, hit);
  }
  std::uint32_t shifts;
  std::memcpy(&shifts, h.boxShift, sizeof(shifts));
  const BoxFrame frame =
      openBoxes(groupStarts, leaves, h.lower, (shifts & 0xffffffu) + 0x7f7f7fu, boxes);
  const VF end = hn::Set(DF(), farEnd(ray.tfar));
  alignas(32) float entry[layout::kMaxLeaves + 8];
  std::uint64_t met = 0;
  for (std::uint32_t first = 0; first < leaves; first += kLanes)
    met |= std::uint64_t(testBoxes(frame, first, boxes.tnear, end, entry + first)) << first;
  met &= ~0ull >> (64 - leaves);
  if (met == 0) return false;

  // What the first leaves will read: records, and vertices about where they must be.
  const std::uint32_t vertexBytes = h.vertices() * h.vertexBits() / 8;
  std::uint64_t soon = met;
  for (int i = 0; i < 3 && soon != 0; ++i, soon &= soon - 1) {
    const auto leaf = static_cast<std::uint32_t>(std::countr_zero(soon));
    const std::uint8_t* vertices = blob + h.vertexOffset + leaf * vertexBytes / leaves;
    __builtin_prefetch(vertices);
    __builtin_prefetch(vertices + 64);
  }
  const Cluster c = openCluster(blob, h, ray.axis, ray.cell);
  bool found = false;
  while (met != 0) {
    const std::uint32_t leaf =
        kAny ? static_cast<std::uint32_t>(std::countr_zero(met)) : nearestOf(met, entry);
    if (!kAny && entry[leaf] > farEnd(ray.tfar)) break;
    met &= ~(1ull << leaf);
    const std::uint8_t* record = blob + layout::recordOffset(bytes, h, leaf);
    found |= testLeaf<kAny>(c, h, record, leaf, cluster, ray, hit);
    if (kAny && found) return true;
  }
  return found;
}

template <bool kAny>
HWY_INLINE bool testCluster(const std::byte* bytes, const BoxRay& boxes, PreparedRay& ray,
                            std::uint32_t cluster, Hit& hit) {
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(bytes);
  return testAsSeen<kAny>(h, ray,
                          [&] { return testLeaves<kAny>(bytes, boxes, ray, cluster, hit); });
}

// A cluster for several rays: boxes and leaves are decoded once, leaves when the first ray meets
// them.
class OpenCluster {
 public:
  OpenCluster(const std::byte* bytes, std::uint32_t number)
      : bytes_(bytes),
        header_(*reinterpret_cast<const layout::ClusterHeader*>(bytes)),
        number_(number) {
    static constexpr std::int32_t kOrder[3] = {0, 1, 2}, kOrigin[3] = {0, 0, 0};
    const auto* blob = reinterpret_cast<const std::uint8_t*>(bytes);
    cluster_ = openCluster(blob, header_, kOrder, kOrigin);
    const std::uint32_t leaves = header_.leafCount;
    if (leaves == 1) return;  // has no boxes
    const std::uint8_t* planes = blob + sizeof(layout::ClusterHeader);
    for (std::uint32_t plane = 0; plane < 6; ++plane, planes += leaves) {
      const std::uint32_t k = plane / 2;
      const VF cell = hn::Set(DF(), static_cast<float>(1u << header_.boxShift[k]));
      const VF lower = hn::Set(DF(), static_cast<float>(header_.lower[k]));
      for (std::uint32_t first = 0; first < leaves; first += kLanes) {
        const VF q = hn::ConvertTo(DF(), hn::PromoteTo(DI(), hn::LoadU(DB(), planes + first)));
        hn::Store(hn::MulAdd(q, cell, lower), DF(), planes_[plane] + first);
      }
    }
  }

  // As testLeaves().
  template <bool kAny>
  HWY_INLINE bool test(PreparedRay& ray, Hit& hit) {
    alignas(32) float entry[layout::kMaxLeaves + 8];
    entry[0] = ray.tnear;
    std::uint64_t met = header_.leafCount == 1 ? 1 : boxesMetBy(ray, entry);
    bool found = false;
    while (met != 0) {
      const std::uint32_t leaf =
          kAny ? static_cast<std::uint32_t>(std::countr_zero(met)) : nearestOf(met, entry);
      if (!kAny && entry[leaf] > farEnd(ray.tfar)) break;
      met &= ~(1ull << leaf);
      if (!(opened_ >> leaf & 1u)) open(leaf);
      found |= testExpandedLeaf<kAny>(leaves_[leaf], ray, hit);
      if (kAny && found) return true;
    }
    return found;
  }

 private:
  HWY_INLINE std::uint64_t boxesMetBy(const PreparedRay& ray, float* entry) const {
    const DF df;
    const PlainRay r = plainRay(ray);
    const VF end = hn::Set(df, farEnd(ray.tfar));
    const float *near[3], *far[3];
    for (int k = 0; k < 3; ++k)
      near[k] = planes_[ray.nearPlane[k]], far[k] = planes_[ray.nearPlane[k] ^ 1u];
    std::uint64_t met = 0;
    for (std::uint32_t first = 0; first < header_.leafCount; first += kLanes)
      met |= std::uint64_t(testPlainBoxes(near, far, first, r, end, entry + first)) << first;
    return met & ~0ull >> (64 - header_.leafCount);
  }
  HWY_NOINLINE void open(std::uint32_t number) {
    const DF df;
    const DI di;
    const LeafCode code = decodeLeaf(reinterpret_cast<const std::uint8_t*>(
        bytes_ + layout::recordOffset(bytes_, header_, number)));
    const LocalVertices vertices(code, [&](VU index) {
      VU offset[3];
      decodeOffsets(cluster_, index, 2, offset);
      const auto grid = [&](int k) {
        return hn::ConvertTo(df,
                             hn::Add(hn::BitCast(di, offset[k]), hn::Set(di, cluster_.anchor[k])));
      };
      return Vertex{grid(0), grid(1), grid(2)};
    });
    ExpandedLeaf& leaf = leaves_[number];
    leaf.cluster = number_;
    leaf.number = static_cast<std::uint8_t>(number);
    leaf.triangles = static_cast<std::uint8_t>(code.triangles);
    for (std::uint32_t first = 0; first < code.triangles; first += kLanes) {
      const Corners c = vertices.corners(code, first);
      for (int i = 0; i < 3; ++i) {
        hn::Store(c.x[i], df, leaf.corner[i][0] + first);
        hn::Store(c.y[i], df, leaf.corner[i][1] + first);
        hn::Store(c.depth[i], df, leaf.corner[i][2] + first);
      }
    }
    opened_ |= 1ull << number;
  }

  const std::byte* bytes_;
  const layout::ClusterHeader& header_;
  std::uint32_t number_;
  Cluster cluster_;
  std::uint64_t opened_ = 0;  // by leaf
  alignas(32) float planes_[6][layout::kMaxLeaves + 8];
  ExpandedLeaf leaves_[layout::kMaxLeaves];
};

struct MeshTracer {
  using Boxes = BoxRay;
  const MeshView& mesh;

  HWY_INLINE BoxRay boxes(const PreparedRay& ray) const { return boxRay(ray); }
  HWY_INLINE std::uint32_t testNode(std::uint32_t number, const BoxRay& ray, float end,
                                    float* entry) const {
    const TopNode& node = mesh.nodes[number];
    std::uint32_t exponents;
    std::memcpy(&exponents, node.exponent, sizeof(exponents));
    const BoxFrame frame = openBoxes(node.planes[0], 8, node.lower, exponents, ray);
    std::uint32_t met = 0;
    for (std::uint32_t first = 0; first < 8; first += kLanes)
      met |= testBoxes(frame, first, ray.tnear, hn::Set(DF(), end), entry + first) << first;
    return met & ((1u << node.children) - 1u);
  }
  HWY_INLINE const std::uint32_t* children(std::uint32_t node) const {
    return mesh.nodes[node].child;
  }
  HWY_INLINE bool isNode(std::uint32_t child) const { return !(child & TopNode::kCluster); }
  template <bool kAny>
  HWY_INLINE bool testLeaf(std::uint32_t child, const BoxRay& boxes, PreparedRay& ray,
                           Hit& hit) const {
    const std::uint32_t cluster = child & ~TopNode::kCluster;
    return testCluster<kAny>(mesh.blob(cluster), boxes, ray, cluster, hit);
  }
  // As testLeaf() for some of kLanes rays.
  template <bool kAny>
  HWY_INLINE std::uint32_t testLeaf(std::uint32_t child, std::uint32_t mask, PreparedRay* rays,
                                    Hit* hits) const {
    const std::uint32_t number = child & ~TopNode::kCluster;
    OpenCluster cluster(mesh.blob(number), number);
    const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(mesh.blob(number));
    std::uint32_t met = 0;
    for (; mask != 0; mask &= mask - 1) {
      const int i = std::countr_zero(mask);
      const auto test = [&] { return cluster.test<kAny>(rays[i], hits[i]); };
      if (testAsSeen<kAny>(h, rays[i], test)) met |= 1u << i;
    }
    return met;
  }
  HWY_INLINE const float* planes(std::uint32_t number, float* buffer) const {
    const TopNode& node = mesh.nodes[number];
    for (std::size_t plane = 0; plane < 6; ++plane) {
      const float cell = std::bit_cast<float>(std::uint32_t(node.exponent[plane / 2]) << 23);
      for (std::size_t first = 0; first < 8; first += kLanes) {
        const VF q =
            hn::ConvertTo(DF(), hn::PromoteTo(DI(), hn::LoadU(DB(), node.planes[plane] + first)));
        const VF lower = hn::ConvertTo(DF(), hn::Set(DI(), node.lower[plane / 2]));
        hn::Store(hn::MulAdd(q, hn::Set(DF(), cell), lower), DF(), buffer + 8 * plane + first);
      }
    }
    return buffer;
  }
  HWY_INLINE void prefetch(std::uint32_t child) const { mesh.prefetch(child); }
  HWY_INLINE void prefetch(const std::uint32_t* children, std::uint32_t met) const {
    for (; met != 0; met &= met - 1) mesh.prefetch(children[std::countr_zero(met)]);
  }
};

bool intersectCluster(const std::byte* blob, PreparedRay& ray, std::uint32_t cluster, Hit& hit) {
  return testCluster<false>(blob, boxRay(ray), ray, cluster, hit);
}
bool occludedCluster(const std::byte* blob, const PreparedRay& ray, std::uint32_t cluster) {
  Hit hit;
  return testCluster<true>(blob, boxRay(ray), const_cast<PreparedRay&>(ray), cluster,
                           hit);  // it stays as it is
}
bool intersectMesh(const MeshView& mesh, PreparedRay& ray, Hit& hit) {
  return testFrom<false>(MeshTracer{mesh}, 0, ray, hit);
}
bool occludedMesh(const MeshView& mesh, const PreparedRay& ray) {
  Hit none;
  return testFrom<true>(MeshTracer{mesh}, 0, const_cast<PreparedRay&>(ray), none);  // it stays
}
void intersectMeshSpan(const MeshView& mesh, std::span<PreparedRay> rays, Hit* hits) {
  intersectSpan(MeshTracer{mesh}, rays, hits);
}
void occludedMeshSpan(const MeshView& mesh, std::span<const PreparedRay> rays,
                      std::uint8_t* blocked) {
  occludedSpan(MeshTracer{mesh}, rays, blocked);
}
void corners(const std::byte* record, std::uint32_t place, std::uint32_t* vertex) {
  cornersOf(decodeLeaf(reinterpret_cast<const std::uint8_t*>(record)), place, vertex);
}
const Kernels* kernels() {
  static const Kernels all = {
      intersectCluster,  occludedCluster,  intersectMesh, occludedMesh,
      intersectMeshSpan, occludedMeshSpan, corners,       hwy::TargetName(HWY_TARGET)};
  return &all;
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hccm {
HWY_EXPORT(kernels);
const Kernels* chooseKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(kernels)();
}
}  // namespace hccm
#endif
