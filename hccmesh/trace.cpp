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

// What all leaves of a cluster share; axes in the ray's order kx, ky, kz.
struct Cluster {
  const std::uint8_t* vertices;
  std::uint32_t vertexBits, widthXy;
  std::uint32_t shift[3], mask[3];
  std::int32_t anchor[3];  // as seen from the ray's cell
};

HWY_INLINE Cluster openCluster(const std::uint8_t* blob, const layout::ClusterHeader& h,
                               const PreparedRay& ray) {
  Cluster c;
  c.vertices = blob + h.vertexOffset;
  const std::uint32_t shifts[3] = {0u, h.width[0], std::uint32_t(h.width[0]) + h.width[1]};
  c.vertexBits = h.vertexBits();
  c.widthXy = shifts[2];
  for (int i = 0; i < 3; ++i) {
    const int k = ray.axis[i];
    c.shift[i] = shifts[k];
    c.mask[i] = (1u << h.width[k]) - 1u;
    c.anchor[i] = h.lower[k] - ray.cell[k];
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

// Exact integers and the ray's own origin, rounded to what single precision has of their distance,
// then operations on these alone: equal vertices of two clusters give equal bits.
HWY_INLINE Vertex decodeVertex(const Cluster& c, const PreparedRay& ray, VU index) {
  const DF df;
  const DI di;
  const DU du;
  const VU bit = hn::Mul(index, hn::Set(du, c.vertexBits));
  const Words words = fetchWords(c.vertices, bit);
  VU offset[3];
  for (int i = 0; i < 3; ++i) offset[i] = lowHalves(words, c.shift[i]);
  if (HWY_UNLIKELY(c.vertexBits > 57)) {  // x and y fit in one word, z in the next
    const Words zWords = fetchWords(c.vertices, hn::Add(bit, hn::Set(du, c.widthXy)));
    for (int i = 0; i < 3; ++i)
      if (ray.axis[i] == 2) offset[i] = lowHalves(zWords, 0);
  }
  VF p[3];
  for (int i = 0; i < 3; ++i) {
    const VU masked = hn::And(offset[i], hn::Set(du, c.mask[i]));
    const auto grid = hn::Add(hn::BitCast(di, masked), hn::Set(di, c.anchor[i]));
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

// The vertices of a leaf in the ray's frame, by local number.
class LocalVertices {
 public:
  HWY_INLINE LocalVertices(const Cluster& c, const LeafCode& leaf, const PreparedRay& ray) {
    const DU du;
    const DB db;
    const auto* numbers = reinterpret_cast<const std::uint8_t*>(leaf.vertex);
    for (std::size_t i = 0; i < kMost && i * kLanes < leaf.locals; ++i)
      set(i, decodeVertex(c, ray, hn::PromoteTo(du, hn::LoadU(db, numbers + i * kLanes))));
    wide_ = leaf.locals > kLanes;
  }
  // Those of kLanes triangles from `first`, from nibbles of local numbers.
  HWY_INLINE Vertex corners(std::uint32_t nibbles, std::uint32_t first) const {
    const DU du;
    const VU shift = hn::ShiftLeft<2>(hn::Iota(du, first));
    const VU number = hn::And(hn::Shr(hn::Set(du, nibbles), shift), hn::Set(du, 15u));
    return {at(x_, number), at(y_, number), at(z_, number)};
  }

 private:
  static constexpr std::size_t kMost = layout::kMaxEntries / kLanes;
#if HWY_TARGET <= HWY_AVX2
  HWY_INLINE void set(std::size_t i, const Vertex& v) { x_[i] = v.x, y_[i] = v.y, z_[i] = v.z; }
  HWY_INLINE VF at(const VF* table, VU number) const {
    const DF df;
    const DU du;
    const auto lane = hn::IndicesFromVec(df, hn::And(number, hn::Set(du, 7u)));
    const VF low = hn::TableLookupLanes(table[0], lane);
    if (!wide_) return low;
    const VF high = hn::TableLookupLanes(table[1], lane);
    return hn::IfNegativeThenElse(hn::BitCast(df, hn::ShiftLeft<28>(number)), high, low);
  }
  VF x_[kMost], y_[kMost], z_[kMost];
#else
  HWY_INLINE void set(std::size_t i, const Vertex& v) {
    const DF df;
    hn::Store(v.x, df, x_ + i * kLanes);
    hn::Store(v.y, df, y_ + i * kLanes);
    hn::Store(v.z, df, z_ + i * kLanes);
  }
  HWY_INLINE VF at(const float* table, VU number) const {
    return hn::GatherIndex(DF(), table, hn::BitCast(DI(), number));
  }
  alignas(32) float x_[layout::kMaxEntries] = {}, y_[layout::kMaxEntries] = {},
                    z_[layout::kMaxEntries] = {};
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
  const LocalVertices vertices(c, code, ray);
  const Leaf leaf{&h,      reinterpret_cast<const std::byte*>(c.vertices),
                  &code,   number,
                  cluster, endsOn(ray, cluster, number)};
  bool found = false;
  for (std::uint32_t first = 0; first < code.triangles && !(kAny && found); first += kLanes)
    found |= testTriangles<kAny>(
        leaf, vertices.corners(code.corner[0], first), vertices.corners(code.corner[1], first),
        vertices.corners(code.corner[2], first), code.triangles - first, first, ray, hit);
  return found;
}

// The ray in the frame of a cluster's quantised boxes: a plane q is met at q * scale + near or far.
// Boxes are widened by a cell for the rounding of vertices (2^-24 of a triangle's extent), by 2^-20
// of the cluster's for that of these planes, and intervals by kTolerance of t for that of both
// tests, which grows with the distance: 7 roundings of 2^-24 on each side.
struct BoxFrame {
  alignas(16) float scale[4];
  alignas(16) float nearOffset[4];
  alignas(16) float farOffset[4];
  const std::uint8_t* nearPlanes[3];
  const std::uint8_t* farPlanes[3];
};

// `planes` has lower and upper ones of each axis in turn, `stride` bytes each. Reads a fourth of
// `lower` and `shift`, which is of no meaning.
HWY_INLINE BoxFrame openBoxes(const std::uint8_t* planes, std::uint32_t stride,
                              const std::int32_t* lower, const std::uint8_t* shift,
                              const PreparedRay& ray) {
  const hn::FixedTag<float, 4> d;
  const hn::RebindToSigned<decltype(d)> di;
  const hn::Rebind<std::uint8_t, decltype(d)> db;
  const auto exponent = hn::Add(hn::PromoteTo(di, hn::LoadU(db, shift)), hn::Set(di, 127));
  const auto cell = hn::BitCast(d, hn::ShiftLeft<23>(exponent));
  const auto inverse = hn::Load(d, ray.inverse);
  const auto cells = hn::Sub(hn::LoadU(di, lower), hn::Load(di, ray.cell));
  const auto base = hn::Sub(hn::ConvertTo(d, cells), hn::Load(d, ray.origin));
  const auto middle = hn::Mul(base, inverse);
  const auto widen =
      hn::Mul(hn::Add(hn::Set(d, 1.0f), hn::Mul(cell, hn::Set(d, 0x1p-12f))), hn::Abs(inverse));
  BoxFrame f;
  hn::Store(hn::Mul(cell, inverse), d, f.scale);
  hn::Store(hn::Sub(middle, widen), d, f.nearOffset);
  hn::Store(hn::Add(middle, widen), d, f.farOffset);
  for (int k = 0; k < 3; ++k) {
    f.nearPlanes[k] = planes + ray.nearPlane[k] * stride;
    f.farPlanes[k] = planes + (ray.nearPlane[k] ^ 1u) * stride;
  }
  return f;
}

HWY_INLINE VF planes(const std::uint8_t* at, float scale, float offset) {
  const DF df;
  const DI di;
  const DB db;
  const VF q = hn::ConvertTo(df, hn::PromoteTo(di, hn::LoadU(db, at)));
  return hn::MulAdd(q, hn::Set(df, scale), hn::Set(df, offset));
}

// Which of kLanes boxes at byte `at` of the planes are met; their entry distances go to `entry`.
HWY_INLINE std::uint32_t testBoxes(const BoxFrame& f, std::size_t at, const PreparedRay& ray,
                                   float* entry) {
  const DF df;
  VF tnear = hn::Set(df, ray.tnear), tfar = hn::Set(df, ray.tfar);
  for (int k = 0; k < 3; ++k) {
    tnear = hn::Max(tnear, planes(f.nearPlanes[k] + at, f.scale[k], f.nearOffset[k]));
    tfar = hn::Min(tfar, planes(f.farPlanes[k] + at, f.scale[k], f.farOffset[k]));
  }
  return boxesMet(tnear, tfar, entry);
}

template <bool kAny>
HWY_INLINE bool testLeaves(const std::byte* bytes, PreparedRay& ray, std::uint32_t cluster,
                           Hit& hit) {
  const std::uint8_t* blob = reinterpret_cast<const std::uint8_t*>(bytes);
  const layout::ClusterHeader& h = *reinterpret_cast<const layout::ClusterHeader*>(blob);
  const std::uint32_t leaves = h.leafCount;
  const std::uint8_t* groupStarts = blob + sizeof(layout::ClusterHeader);
  if (leaves == 1) {
    const Cluster c = openCluster(blob, h, ray);
    return testLeaf<kAny>(c, h, blob + layout::recordOffset(bytes, h, 0), 0, cluster, ray, hit);
  }
  const BoxFrame frame = openBoxes(groupStarts, leaves, h.lower, h.boxShift, ray);
  alignas(32) float entry[layout::kMaxLeaves + 8];
  std::uint64_t met = 0;
  for (std::uint32_t first = 0; first < leaves; first += kLanes)
    met |= std::uint64_t(testBoxes(frame, first, ray, entry + first)) << first;
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
  const Cluster c = openCluster(blob, h, ray);
  bool found = false;
  while (met != 0) {
    auto leaf = static_cast<std::uint32_t>(std::countr_zero(met));
    if (!kAny)  // nearest box first
      for (std::uint64_t rest = met & (met - 1); rest != 0; rest &= rest - 1) {
        const auto other = static_cast<std::uint32_t>(std::countr_zero(rest));
        if (entry[other] < entry[leaf]) leaf = other;
      }
    if (!kAny && entry[leaf] > ray.tfar) break;
    met &= ~(1ull << leaf);
    const std::uint8_t* record = blob + layout::recordOffset(bytes, h, leaf);
    found |= testLeaf<kAny>(c, h, record, leaf, cluster, ray, hit);
    if (kAny && found) return true;
  }
  return found;
}

template <bool kAny>
HWY_INLINE bool testCluster(const std::byte* bytes, PreparedRay& ray, std::uint32_t cluster,
                            Hit& hit) {
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(bytes);
  return testAsSeen<kAny>(h, ray, [&] { return testLeaves<kAny>(bytes, ray, cluster, hit); });
}

// Nearest first through the top level, down to triangles. Children wait on a stack with the
// distance of their boxes.
template <bool kAny>
HWY_INLINE bool testMesh(const MeshView& mesh, PreparedRay& ray, Hit& hit) {
  struct Waiting {
    std::uint32_t child;
    float entry;
  };
  Waiting stack[7 * TopLevel::kMaxDepth + 8];
  std::size_t waiting = 0;
  bool found = false;
  std::uint32_t child = 0;
  for (;;) {
    if (child & TopNode::kCluster) {
      const std::uint32_t cluster = child & ~TopNode::kCluster;
      found |= testCluster<kAny>(mesh.blob(cluster), ray, cluster, hit);
      if (kAny && found) return true;
    } else {
      const TopNode& node = mesh.nodes[child];
      const BoxFrame frame = openBoxes(node.planes[0], 8, node.lower, node.shift, ray);
      alignas(32) float entry[8];
      std::uint32_t met = 0;
      for (std::uint32_t first = 0; first < 8; first += kLanes)
        met |= testBoxes(frame, first, ray, entry + first) << first;
      met &= (1u << node.children) - 1u;
      const std::size_t base = waiting;
      for (; met != 0; met &= met - 1) {
        const auto i = static_cast<std::uint32_t>(std::countr_zero(met));
        const std::uint32_t next = node.child[i];
        mesh.prefetch(next);
        std::size_t at = waiting++;
        for (; !kAny && at > base && stack[at - 1].entry < entry[i]; --at)
          stack[at] = stack[at - 1];
        stack[at] = {next, entry[i]};
      }
    }
    do {
      if (waiting == 0) return found;
      --waiting;
    } while (!kAny && stack[waiting].entry > ray.tfar);
    child = stack[waiting].child;
  }
}

bool intersectCluster(const std::byte* blob, PreparedRay& ray, std::uint32_t cluster, Hit& hit) {
  return testCluster<false>(blob, ray, cluster, hit);
}
bool occludedCluster(const std::byte* blob, const PreparedRay& ray, std::uint32_t cluster) {
  Hit hit;
  return testCluster<true>(blob, const_cast<PreparedRay&>(ray), cluster, hit);  // it stays as it is
}
bool intersectMesh(const MeshView& mesh, PreparedRay& ray, Hit& hit) {
  return testMesh<false>(mesh, ray, hit);
}
bool occludedMesh(const MeshView& mesh, const PreparedRay& ray) {
  Hit hit;
  return testMesh<true>(mesh, const_cast<PreparedRay&>(ray), hit);
}
void corners(const std::byte* record, std::uint32_t place, std::uint32_t* vertex) {
  cornersOf(decodeLeaf(reinterpret_cast<const std::uint8_t*>(record)), place, vertex);
}
Kernels kernels() {
  return {intersectCluster, occludedCluster, intersectMesh,
          occludedMesh,     corners,         hwy::TargetName(HWY_TARGET)};
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hccm {
HWY_EXPORT(kernels);
Kernels chooseKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(kernels)();
}
}  // namespace hccm
#endif
