// One ray against one cluster: boxes of 8 leaves at once, then 8 triangles at once. Compiled once
// for each instruction set [Highway's foreach_target]; every one gives the same bits, because only
// exactly rounded operations decide a hit (no fused multiply-add, no approximate reciprocal).
#include "hccmesh/trace.h"

#include <array>
#include <bit>
#include <cstring>
#include <limits>

#include "hccmesh/layout.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hccmesh/trace.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef HCCM_TRACE_ONCE
#define HCCM_TRACE_ONCE
namespace hccm {

// How 8 index triples of 3*b bits, the first at bit `s` of a byte, lie in bytes: for each block of
// 4 lanes where its 16 bytes are loaded from, which bytes make a lane, and the shift within it.
struct alignas(32) TripleDecode {
  std::uint8_t bytes[32];
  std::uint32_t shift[8];
  std::uint32_t blockByte[2];
};

constexpr std::array<TripleDecode, 9 * 8> makeTripleDecode() {
  std::array<TripleDecode, 9 * 8> table{};
  for (std::uint32_t bits = 0; bits <= 8; ++bits)
    for (std::uint32_t start = 0; start < 8; ++start) {
      TripleDecode& d = table[bits * 8 + start];
      for (std::uint32_t lane = 0; lane < 8; ++lane) {
        const std::uint32_t block = lane / 4, first = start + block * 4 * 3 * bits;
        const std::uint32_t position = start + lane * 3 * bits;
        d.blockByte[block] = first / 8;
        d.shift[lane] = position % 8;
        for (std::uint32_t k = 0; k < 4; ++k)
          d.bytes[lane * 4 + k] = static_cast<std::uint8_t>(position / 8 - first / 8 + k);
      }
    }
  return table;
}
inline constexpr std::array<TripleDecode, 9 * 8> kTripleDecode = makeTripleDecode();

inline constexpr float kTolerance = 0x1p-19f;  // of t; see the boxes below

}  // namespace hccm
#endif

HWY_BEFORE_NAMESPACE();
namespace hccm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, 8>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using DB = hn::Rebind<std::uint8_t, DF>;
using VF = hn::Vec<DF>;
using VU = hn::Vec<DU>;
using MF = hn::Mask<DF>;
constexpr std::size_t kLanes = hn::MaxLanes(DF());
static_assert(kLanes == 4 || kLanes == 8);

// What all leaves of a cluster share; axes in the ray's order kx, ky, kz.
struct Cluster {
  const std::uint8_t* topology;
  const std::uint8_t* vertices;
  std::uint32_t triangles, indexBits, vertexBits, widthXy;
  std::uint32_t shift[3], mask[3];
  std::int32_t anchor[3];
};

HWY_INLINE Cluster openCluster(const std::uint8_t* blob, const layout::ClusterHeader& h,
                               const PreparedRay& ray) {
  Cluster c;
  c.topology = blob + h.topologyOffset;
  c.vertices = blob + h.vertexOffset;
  c.triangles = h.triangles();
  c.indexBits = h.indexBits;
  const std::uint32_t shifts[3] = {0u, h.width[0], std::uint32_t(h.width[0]) + h.width[1]};
  c.vertexBits = h.vertexBits();
  c.widthXy = shifts[2];
  for (int i = 0; i < 3; ++i) {
    const int k = ray.axis[i];
    c.shift[i] = shifts[k];
    c.mask[i] = (1u << h.width[k]) - 1u;
    c.anchor[i] = h.anchor[k];
  }
  return c;
}

// A 64-bit word for each lane: in one vector where registers are wide enough, else in two.
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
// Byte offsets need not be aligned.
HWY_INLINE hn::Vec<DQ> gather64(const std::uint8_t* base, hn::Vec<DQ> offset) {
  const DQ dq;
#if HWY_TARGET <= HWY_AVX2
  const hn::RebindToSigned<DQ> ds;
  return hn::GatherOffset(dq, reinterpret_cast<const std::uint64_t*>(base),
                          hn::BitCast(ds, offset));
#else
  alignas(32) std::uint64_t lanes[hn::MaxLanes(DQ())];
  hn::Store(offset, dq, lanes);
  for (std::uint64_t& lane : lanes) std::memcpy(&lane, base + lane, sizeof(lane));
  return hn::Load(dq, lanes);
#endif
}
HWY_INLINE Words fetchWords(const std::uint8_t* base, VU bit) {
  const DU du;
  const DUHalf dh;
  const DQ dq;
  const VU byte = hn::ShiftRight<3>(bit), shift = hn::And(bit, hn::Set(du, 7u));
  const auto low = gather64(base, hn::PromoteTo(dq, hn::LowerHalf(dh, byte)));
  const auto high = gather64(base, hn::PromoteTo(dq, hn::UpperHalf(dh, byte)));
  return {hn::Shr(low, hn::PromoteTo(dq, hn::LowerHalf(dh, shift))),
          hn::Shr(high, hn::PromoteTo(dq, hn::UpperHalf(dh, shift)))};
}
HWY_INLINE VU lowHalves(const Words& w, std::uint32_t shift) {
  const DU du;
  const int bits = static_cast<int>(shift);
  return hn::ConcatEven(du, hn::BitCast(du, hn::ShiftRightSame(w.high, bits)),
                        hn::BitCast(du, hn::ShiftRightSame(w.low, bits)));
}
#endif

struct Vertex {
  VF x, y, z;  // sheared to the ray's frame; z along the ray in units of its direction, cells
};

// One rounding of exact integers and the ray's own origin, then operations on these alone: equal
// vertices of two clusters give equal bits.
HWY_INLINE Vertex decodeVertex(const Cluster& c, const PreparedRay& ray, VU index) {
  const DF df;
  const DI di;
  const DU du;
  const VU bit = hn::Mul(index, hn::Set(du, c.vertexBits));
  VU offset[3];
  if (HWY_LIKELY(c.vertexBits <= 57)) {
    const Words words = fetchWords(c.vertices, bit);
    for (int i = 0; i < 3; ++i) offset[i] = lowHalves(words, c.shift[i]);
  } else {
    // x and y fit in one word, z in the next.
    const Words xy = fetchWords(c.vertices, bit);
    const Words z = fetchWords(c.vertices, hn::Add(bit, hn::Set(du, c.widthXy)));
    for (int i = 0; i < 3; ++i)
      offset[i] = ray.axis[i] == 2 ? lowHalves(z, 0) : lowHalves(xy, c.shift[i]);
  }
  VF p[3];
  for (int i = 0; i < 3; ++i) {
    const VU masked = hn::And(offset[i], hn::Set(du, c.mask[i]));
    const auto grid = hn::Add(hn::BitCast(di, masked), hn::Set(di, c.anchor[i]));
    p[i] = hn::Sub(hn::ConvertTo(df, grid), hn::Set(df, ray.origin[ray.axis[i]]));
  }
  Vertex v;
  v.x = hn::Sub(p[0], hn::Mul(hn::Set(df, ray.shear[0]), p[2]));
  v.y = hn::Sub(p[1], hn::Mul(hn::Set(df, ray.shear[1]), p[2]));
  v.z = hn::Mul(hn::Set(df, ray.shear[2]), p[2]);
  return v;
}

// Index triples of kLanes triangles from `first`, packed as stored in the low bits of each lane;
// zero for lanes from `count` on.
HWY_INLINE VU decodeTriples(const Cluster& c, std::uint32_t first, std::size_t count) {
  const DU du;
  const hn::Repartition<std::uint8_t, DU> db;
  const std::uint32_t position = first * 3u * c.indexBits;
  const std::uint8_t* at = c.topology + position / 8u;
  const TripleDecode& table = kTripleDecode[c.indexBits * 8u + position % 8u];
#if HWY_TARGET <= HWY_AVX2
  const hn::Half<decltype(db)> dhalf;
  const auto raw = hn::Combine(db, hn::LoadU(dhalf, at + table.blockByte[1]), hn::LoadU(dhalf, at));
#else
  const auto raw = hn::LoadU(db, at);
#endif
  const VU words = hn::BitCast(du, hn::TableLookupBytes(raw, hn::Load(db, table.bytes)));
  const VU shifted = hn::Shr(words, hn::Load(du, table.shift));
  return hn::IfThenElseZero(hn::FirstN(du, count), shifted);
}

struct Edges {
  VF u, v, w;
};

// Signs of edge functions that came out as zero in single precision: products of floats are exact
// in double, so is the sign of their difference.
HWY_NOINLINE void resolveZeros(const Vertex& a, const Vertex& b, const Vertex& c, Edges& e) {
  const DF df;
  alignas(32) float ax[kLanes], ay[kLanes], bx[kLanes], by[kLanes], cx[kLanes], cy[kLanes];
  alignas(32) float u[kLanes], v[kLanes], w[kLanes];
  hn::Store(a.x, df, ax), hn::Store(a.y, df, ay), hn::Store(b.x, df, bx);
  hn::Store(b.y, df, by), hn::Store(c.x, df, cx), hn::Store(c.y, df, cy);
  const auto edge = [](float px, float py, float qx, float qy) {
    return static_cast<float>(double(px) * double(qy) - double(py) * double(qx));
  };
  for (std::size_t i = 0; i < kLanes; ++i) {
    u[i] = edge(cx[i], cy[i], bx[i], by[i]);
    v[i] = edge(ax[i], ay[i], cx[i], cy[i]);
    w[i] = edge(bx[i], by[i], ax[i], ay[i]);
  }
  e = {hn::Load(df, u), hn::Load(df, v), hn::Load(df, w)};
}

// Takes the nearest of the accepted lanes into hit; on equal t the lower (cluster, triangle).
HWY_INLINE bool takeNearest(std::uint32_t bits, VF t, VF u, VF v, std::uint32_t first,
                            std::uint32_t cluster, PreparedRay& ray, Hit& hit) {
  const DF df;
  alignas(32) float ts[kLanes], us[kLanes], vs[kLanes];
  hn::Store(t, df, ts), hn::Store(u, df, us), hn::Store(v, df, vs);
  bool found = false;
  for (; bits != 0; bits &= bits - 1) {
    const int lane = std::countr_zero(bits);
    const std::uint32_t triangle = first + static_cast<std::uint32_t>(lane);
    const bool lower = cluster < hit.cluster || (cluster == hit.cluster && triangle < hit.triangle);
    if (!(ts[lane] < ray.tfar || (ts[lane] == ray.tfar && lower))) continue;
    ray.tfar = ts[lane];
    hit = {static_cast<float>((double(ts[lane]) + ray.shift) * double(ray.step)), us[lane],
           vs[lane], cluster, triangle};
    found = true;
  }
  return found;
}

// Watertight test [Woop et al. 2013] of up to kLanes triangles from `first`. No multiply-add: an
// edge must give the exact negative when its ends are exchanged.
template <bool kAny>
HWY_INLINE bool testTriangles(const Cluster& c, std::uint32_t first, std::size_t count,
                              std::uint32_t cluster, PreparedRay& ray, Hit& hit) {
  const DF df;
  const DU du;
  const VU triples = decodeTriples(c, first, count);
  const VU indexMask = hn::Set(du, (1u << c.indexBits) - 1u);
  const int bits = static_cast<int>(c.indexBits);
  const Vertex a = decodeVertex(c, ray, hn::And(triples, indexMask));
  const Vertex b = decodeVertex(c, ray, hn::And(hn::ShiftRightSame(triples, bits), indexMask));
  const Vertex d = decodeVertex(c, ray, hn::And(hn::ShiftRightSame(triples, 2 * bits), indexMask));

  Edges e = {hn::Sub(hn::Mul(d.x, b.y), hn::Mul(d.y, b.x)),
             hn::Sub(hn::Mul(a.x, d.y), hn::Mul(a.y, d.x)),
             hn::Sub(hn::Mul(b.x, a.y), hn::Mul(b.y, a.x))};
  const VF zero = hn::Zero(df);
  const MF active = hn::FirstN(df, count);
  const auto inside = [&] {
    const VF least = hn::Min(hn::Min(e.u, e.v), e.w), most = hn::Max(hn::Max(e.u, e.v), e.w);
    return hn::And(active, hn::Or(hn::Ge(least, zero), hn::Le(most, zero)));
  };
  MF accept = inside();
  if (hn::AllFalse(df, accept)) return false;
  const MF zeros = hn::Or(hn::Or(hn::Eq(e.u, zero), hn::Eq(e.v, zero)), hn::Eq(e.w, zero));
  if (HWY_UNLIKELY(!hn::AllFalse(df, hn::And(accept, zeros)))) {
    resolveZeros(a, b, d, e);
    accept = inside();
  }

  const VF determinant = hn::Add(hn::Add(e.u, e.v), e.w);
  accept = hn::And(accept, hn::Ne(determinant, zero));
  const VF reciprocal = hn::Div(hn::Set(df, 1.0f), determinant);
  const VF u = hn::Mul(e.u, reciprocal), v = hn::Mul(e.v, reciprocal), w = hn::Mul(e.w, reciprocal);
  const VF t = hn::Add(hn::Add(hn::Mul(u, a.z), hn::Mul(v, b.z)), hn::Mul(w, d.z));
  const VF finite = hn::Set(df, std::numeric_limits<float>::max());
  accept = hn::And(accept, hn::And(hn::Ge(t, hn::Set(df, ray.tnear)),
                                   hn::Le(t, hn::Min(finite, hn::Set(df, ray.tfar)))));
  if (hn::AllFalse(df, accept)) return false;
  if constexpr (kAny) return true;
  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, accept, lanes);
  return takeNearest(lanes[0], t, v, w, first, cluster, ray, hit);
}

template <bool kAny>
HWY_INLINE bool testLeaf(const Cluster& c, std::uint32_t first, std::uint32_t count,
                         std::uint32_t cluster, PreparedRay& ray, Hit& hit) {
  bool found = testTriangles<kAny>(c, first, count < kLanes ? count : kLanes, cluster, ray, hit);
  if (kLanes < layout::kLeafSize && count > kLanes && !(kAny && found))
    found |= testTriangles<kAny>(c, first + kLanes, count - kLanes, cluster, ray, hit);
  return found;
}

// The ray in the frame of a cluster's quantised boxes: a plane q is met at q * scale + near or far.
// Boxes are widened by a cell for the rounding of vertices (2^-24 of a triangle's extent), by 2^-20
// of the cluster's for that of these planes, and intervals by kTolerance of t for that of both
// tests, which grows with the distance: 7 roundings of 2^-24 on each side.
struct BoxFrame {
  float scale[3], nearOffset[3], farOffset[3];
  const std::uint8_t* nearPlanes[3];
  const std::uint8_t* farPlanes[3];
};

HWY_INLINE BoxFrame openBoxes(const std::uint8_t* boxes, const layout::ClusterHeader& h,
                              const PreparedRay& ray) {
  BoxFrame f;
  for (int k = 0; k < 3; ++k) {
    const float cell = static_cast<float>(1u << h.boxShift[k]);
    const float widen = 1.0f + cell * 0x1p-12f;
    const float base = static_cast<float>(h.anchor[k]) - ray.origin[k];
    const float inverse = ray.inverse[k];
    const bool negative = inverse < 0.0f;
    f.scale[k] = cell * inverse;
    f.nearOffset[k] = (negative ? base + widen : base - widen) * inverse;
    f.farOffset[k] = (negative ? base - widen : base + widen) * inverse;
    f.nearPlanes[k] = boxes + 16 * k + (negative ? 8 : 0);
    f.farPlanes[k] = boxes + 16 * k + (negative ? 0 : 8);
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
  const VF tolerance = hn::Set(df, kTolerance);
  const VF least = hn::Sub(tnear, hn::Mul(hn::Abs(tnear), tolerance));
  const VF most = hn::Min(hn::Set(df, std::numeric_limits<float>::max()),
                          hn::Add(tfar, hn::Mul(hn::Abs(tfar), tolerance)));
  hn::StoreU(least, df, entry);
  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, hn::Le(least, most), lanes);
  return lanes[0];
}

template <bool kAny>
HWY_INLINE bool testCluster(const std::byte* bytes, PreparedRay& ray, std::uint32_t cluster,
                            Hit& hit) {
  const std::uint8_t* blob = reinterpret_cast<const std::uint8_t*>(bytes);
  const layout::ClusterHeader& h = *reinterpret_cast<const layout::ClusterHeader*>(blob);
  const Cluster c = openCluster(blob, h, ray);
  if (h.leafCount == 1) return testLeaf<kAny>(c, 0, c.triangles, cluster, ray, hit);

  const std::uint8_t* boxes = blob + sizeof(layout::ClusterHeader);
  const std::uint32_t groups = h.groups();
  const std::uint8_t* starts = boxes + groups * layout::kGroupBytes;
  const BoxFrame frame = openBoxes(boxes, h, ray);
  alignas(32) float entry[layout::kMaxLeaves];
  std::uint32_t met = 0;
  for (std::uint32_t g = 0; g < groups; ++g)
    for (std::uint32_t lane = 0; lane < 8; lane += kLanes)
      met |= testBoxes(frame, g * layout::kGroupBytes + lane, ray, entry + g * 8 + lane)
             << (g * 8 + lane);
  met &= h.leafCount >= 32u ? 0xffffffffu : (1u << h.leafCount) - 1u;

  bool found = false;
  while (met != 0) {
    std::uint32_t leaf = static_cast<std::uint32_t>(std::countr_zero(met));
    if (!kAny)  // nearest box first
      for (std::uint32_t rest = met & (met - 1); rest != 0; rest &= rest - 1) {
        const auto other = static_cast<std::uint32_t>(std::countr_zero(rest));
        if (entry[other] < entry[leaf]) leaf = other;
      }
    if (!kAny && entry[leaf] > ray.tfar) break;
    met &= ~(1u << leaf);
    const std::uint32_t first = starts[leaf];
    const std::uint32_t end = leaf + 1 < h.leafCount ? starts[leaf + 1] : c.triangles;
    found |= testLeaf<kAny>(c, first, end - first, cluster, ray, hit);
    if (kAny && found) return true;
  }
  return found;
}

bool intersectCluster(const std::byte* blob, PreparedRay& ray, std::uint32_t cluster, Hit& hit) {
  return testCluster<false>(blob, ray, cluster, hit);
}
bool occludedCluster(const std::byte* blob, const PreparedRay& ray) {
  Hit hit;
  return testCluster<true>(blob, const_cast<PreparedRay&>(ray), 0, hit);  // kAny leaves it as it is
}
Kernels kernels() { return {intersectCluster, occludedCluster, hwy::TargetName(HWY_TARGET)}; }

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
