// The test of a ray against up to eight triangles, for one instruction set: included by the files
// that Highway compiles once for each. Every set gives the same bits, because only exactly rounded
// operations decide a hit (no fused multiply-add, no approximate reciprocal).
#ifndef HCCM_TRACE_ONCE
#define HCCM_TRACE_ONCE
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"

namespace hccm {
inline constexpr float kTolerance = 0x1p-19f;  // of t; see the boxes

// A triangle that single precision says a ray goes through: where it does in double.
struct Candidate {
  double t, u, v;  // as single precision has them, then exactly; u, v of corners b and c
  double blur;     // of t, as single precision has it
  bool meets(const glm::dvec3 (&p)[3], const PreparedRay& ray);
};

// `p`: corners, grid cells. False if it is in one plane with the ray's start or target, or not in
// the ray's interval. The integers and their differences are exact in double, and so is the normal;
// the origin is off by 2^-53 of itself. A triangle without area has no plane: its t stays as it is.
inline bool Candidate::meets(const glm::dvec3 (&p)[3], const PreparedRay& ray) {
  const glm::dvec3 e1 = p[1] - p[0], e2 = p[2] - p[0], a = p[0] - ray.exactOrigin;
  const glm::dvec3 normal = glm::cross(e1, e2);
  const double size = std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z);
  if (size == 0.0) {
    return t - blur >= double(ray.tnear) && t + blur <= double(ray.tfar);
  }
  const double height = glm::dot(normal, a), determinant = glm::dot(normal, ray.direction);
  if (std::abs(height) <= ray.slack * size) return false;
  if (ray.targetSlack >= 0.0 &&
      std::abs(glm::dot(normal, p[0] - ray.target)) <= ray.targetSlack * size) {
    return false;
  }
  if (determinant == 0.0) return false;  // along its plane
  // [Moeller and Trumbore 1997]
  const double inverse = 1.0 / determinant;
  const glm::dvec3 moment = glm::cross(a, ray.direction);
  t = height * inverse;
  u = glm::dot(moment, e2) * inverse;
  v = -glm::dot(moment, e1) * inverse;
  // Single precision has let it through at an edge. A point on the edge itself would be as close to
  // the plane of the neighbour as a point can be, so it moves inside by a millionth, but no more
  // than a thousandth of a cell.
  if (!(u >= 0.0 && v >= 0.0 && u + v <= 1.0)) {
    const double inside =
        std::min(0x1p-20, 0x1p-10 / std::sqrt(std::max(glm::dot(e1, e1), glm::dot(e2, e2))));
    u = std::clamp(u, inside, 1.0), v = std::clamp(v, inside, 1.0);
    const double most = std::max(1.0, (u + v) * (1.0 + inside));
    u /= most, v /= most;
    t = glm::dot(a + u * e1 + v * e2, ray.direction) / glm::dot(ray.direction, ray.direction);
  }
  return t >= double(ray.tnear);
}
}  // namespace hccm
#endif

#if defined(HCCM_TRACE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef HCCM_TRACE_INL
#undef HCCM_TRACE_INL
#else
#define HCCM_TRACE_INL
#endif

#include <hwy/highway.h>

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

struct Vertex {
  VF x, y, z;  // sheared to the ray's frame; z along the ray in units of its direction, cells
};

// From a corner's distance to the origin, axes in the ray's order.
HWY_INLINE Vertex shearVertex(const VF (&p)[3], const PreparedRay& ray) {
  const DF df;
  Vertex v;
  v.x = hn::Sub(p[0], hn::Mul(hn::Set(df, ray.shear[0]), p[2]));
  v.y = hn::Sub(p[1], hn::Mul(hn::Set(df, ray.shear[1]), p[2]));
  v.z = hn::Mul(hn::Set(df, ray.shear[2]), p[2]);
  return v;
}

// Which boxes are met between these distances, give or take kTolerance; where they are entered goes
// to `entry`.
HWY_INLINE std::uint32_t boxesMet(VF tnear, VF tfar, float* entry) {
  const DF df;
  const VF tolerance = hn::Set(df, kTolerance);
  const VF least = hn::Sub(tnear, hn::Mul(hn::Abs(tnear), tolerance));
  const VF most = hn::Min(hn::Set(df, std::numeric_limits<float>::max()),
                          hn::Add(tfar, hn::Mul(hn::Abs(tfar), tolerance)));
  hn::StoreU(least, df, entry);
  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, hn::Le(least, most), lanes);
  return lanes[0];
}

struct Edges {
  VF u, v, w;
};

// Signs of edge functions that came out as zero in single precision: products of floats are exact
// in double, so is the sign of their difference.
inline HWY_NOINLINE void resolveZeros(const Vertex& a, const Vertex& b, const Vertex& c, Edges& e) {
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

// How wrong t of single precision can be. Vertices are off by 2^-24 of (2 of their own distance,
// and 4 of their depth for the shears), so edge functions by 2^-24 (15 x^2 + 24 x z), for |x|, |y|
// <= x and depths <= z; weights are off by that over the determinant, and t by that times the range
// of depths, plus the rounding of depths and weighted sums, which is less than 2^-20 of the
// largest.
HWY_INLINE VF blurOf(const Vertex& a, const Vertex& b, const Vertex& d, VF determinant,
                     const PreparedRay& ray) {
  const DF df;
  const auto most = [](VF p, VF q, VF r) { return hn::Max(hn::Max(p, q), r); };
  const VF x = hn::Max(most(hn::Abs(a.x), hn::Abs(b.x), hn::Abs(d.x)),
                       most(hn::Abs(a.y), hn::Abs(b.y), hn::Abs(d.y)));
  const VF z = most(hn::Abs(a.z), hn::Abs(b.z), hn::Abs(d.z));
  const VF range = hn::Sub(most(a.z, b.z, d.z), hn::Min(hn::Min(a.z, b.z), d.z));
  const VF edges =
      hn::Mul(hn::Mul(x, hn::Set(df, 3.0f * 0x1p-24f)),
              hn::Add(hn::Mul(x, hn::Set(df, 15.0f)), hn::Mul(z, hn::Set(df, 24.0f * ray.depth))));
  const VF sure = hn::Max(hn::Sub(hn::Abs(determinant), edges), hn::Zero(df));
  // Of a sliver in the ray's direction nothing is known but that t is in its range of depths.
  const VF share = hn::Min(hn::Div(edges, hn::Add(sure, hn::Mul(edges, hn::Set(df, 0x1p-20f)))),
                           hn::Set(df, 2.0f));
  return hn::Add(hn::Mul(range, share), hn::Mul(z, hn::Set(df, 0x1p-20f)));
}

// A bit for each triangle of a leaf that the ray leaves or ends on.
HWY_INLINE std::uint32_t endsOn(const PreparedRay& ray, std::uint32_t cluster, std::uint32_t leaf) {
  const auto bitOf = [&](std::uint32_t ofCluster, std::uint32_t triangle) {
    const bool here = ofCluster == cluster && triangle / layout::kLeafSize == leaf;
    return here ? 1u << triangle % layout::kLeafSize : 0u;
  };
  return bitOf(ray.fromCluster, ray.fromTriangle) | bitOf(ray.toCluster, ray.toTriangle);
}

// What test() finds of a cluster, as far as the ray sees the cluster and it does not let rays pass.
template <bool kAny, typename Test>
HWY_INLINE bool testAsSeen(const layout::ClusterHeader& h, PreparedRay& ray, const Test& test) {
  if (ray.hidden != nullptr && ray.hidden[h.object] != 0) return false;
  if (!kAny || ray.passages == nullptr) return test();
  const Passage passage = ray.passages->ofMaterial[h.material];
  const bool passes = passage == Passage::kPasses;
  if (passage == Passage::kAbsent || (passes && ray.passages->met)) return false;
  const bool found = test();
  if (!passes) return found;
  ray.passages->met |= found;
  return false;
}

// Below, a Leaf has the triangles for the second look: their `cluster`, the leaf's `number` in it,
// `ends` as endsOn(), and readCorners(place, p), grid cells.

// Takes the nearest of the accepted lanes into hit; on equal t the lower (cluster, triangle).
// kAny: whether there is one.
template <bool kAny, typename Leaf>
HWY_INLINE bool takeNearest(const Leaf& leaf, std::uint32_t bits, VF t, VF u, VF v, VF blur,
                            std::uint32_t first, PreparedRay& ray, Hit& hit) {
  const DF df;
  alignas(32) float ts[kLanes], us[kLanes], vs[kLanes], blurs[kLanes];
  hn::Store(t, df, ts), hn::Store(u, df, us), hn::Store(v, df, vs), hn::Store(blur, df, blurs);
  bool found = false;
  for (; bits != 0; bits &= bits - 1) {
    const int lane = std::countr_zero(bits);
    const std::uint32_t place = first + static_cast<std::uint32_t>(lane);
    const std::uint32_t triangle = layout::kLeafSize * leaf.number + place;
    // Far from both ends by more than any doubt, nothing more needs to be known.
    if (kAny && ts[lane] - blurs[lane] > ray.sureFrom && ts[lane] + blurs[lane] < ray.sureTo) {
      return true;
    }
    glm::dvec3 corners[3];
    leaf.readCorners(place, corners);
    Candidate c{ts[lane], us[lane], vs[lane], blurs[lane]};
    if (!c.meets(corners, ray)) continue;
    const auto at = static_cast<float>(c.t);
    const bool lower =
        leaf.cluster < hit.cluster || (leaf.cluster == hit.cluster && triangle < hit.triangle);
    if (!(at < ray.tfar || (at == ray.tfar && lower))) continue;
    if constexpr (kAny) return true;
    ray.tfar = at;
    hit = {c.u, c.v, static_cast<float>((c.t + ray.shift) * double(ray.step)), leaf.cluster,
           triangle};
    found = true;
  }
  return found;
}

// Of the triangles that the ray goes through, by bits. Most leaves that are visited have none: kept
// apart, it leaves registers to what comes before.
template <bool kAny, typename Leaf>
HWY_NOINLINE bool takeInside(const Leaf& leaf, const Vertex& a, const Vertex& b, const Vertex& d,
                             const Edges& e, std::uint8_t inside, std::uint32_t first,
                             PreparedRay& ray, Hit& hit) {
  const DF df;
  std::uint8_t lanes[8] = {inside};
  MF accept = hn::LoadMaskBits(df, lanes);
  const VF determinant = hn::Add(hn::Add(e.u, e.v), e.w);
  accept = hn::And(accept, hn::Ne(determinant, hn::Zero(df)));
  const VF reciprocal = hn::Div(hn::Set(df, 1.0f), determinant);
  const VF u = hn::Mul(e.u, reciprocal), v = hn::Mul(e.v, reciprocal), w = hn::Mul(e.w, reciprocal);
  const VF t = hn::Add(hn::Add(hn::Mul(u, a.z), hn::Mul(v, b.z)), hn::Mul(w, d.z));
  const VF blur = blurOf(a, b, d, determinant, ray);
  const VF finite = hn::Set(df, std::numeric_limits<float>::max());
  accept =
      hn::And(accept, hn::And(hn::Ge(hn::Add(t, blur), hn::Set(df, ray.tnear)),
                              hn::Le(hn::Sub(t, blur), hn::Min(finite, hn::Set(df, ray.tfar)))));
  if (hn::AllFalse(df, accept)) return false;
  hn::StoreMaskBits(df, accept, lanes);
  return takeNearest<kAny>(leaf, lanes[0], t, v, w, blur, first, ray, hit);
}

// Watertight test [Woop et al. 2013] of up to kLanes triangles; `first` is the place of the first.
// No multiply-add: an edge must give the exact negative when its ends are exchanged.
template <bool kAny, typename Leaf>
HWY_INLINE bool testTriangles(const Leaf& leaf, const Vertex& a, const Vertex& b, const Vertex& d,
                              std::size_t count, std::uint32_t first, PreparedRay& ray, Hit& hit) {
  const DF df;
  Edges e = {hn::Sub(hn::Mul(d.x, b.y), hn::Mul(d.y, b.x)),
             hn::Sub(hn::Mul(a.x, d.y), hn::Mul(a.y, d.x)),
             hn::Sub(hn::Mul(b.x, a.y), hn::Mul(b.y, a.x))};
  const VF zero = hn::Zero(df);
  MF active = hn::FirstN(df, count);
  if (HWY_UNLIKELY(leaf.ends != 0)) {
    const std::uint8_t ends[8] = {static_cast<std::uint8_t>(leaf.ends >> first)};
    active = hn::AndNot(hn::LoadMaskBits(df, ends), active);
  }
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

  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, accept, lanes);
  return takeInside<kAny>(leaf, a, b, d, e, lanes[0], first, ray, hit);
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#endif
