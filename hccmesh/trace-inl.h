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

#include "hccmesh/expanded.h"
#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/top_level.h"

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
  // Single precision has let it through at an edge, of the wrong one of two that share it maybe. A
  // point on the edge itself would be as close to the plane of the neighbour as a point can be, so
  // it moves inside by a millionth, but no more than a thousandth of a cell. The ray is off that
  // point by as much as corners far away are rounded; t stays that of the plane, or something
  // closely behind the triangle would be met before it, but of an edge-on one it does not run away.
  if (!(u >= 0.0 && v >= 0.0 && u + v <= 1.0)) {
    const double inside =
        std::min(0x1p-20, 0x1p-10 / std::sqrt(std::max(glm::dot(e1, e1), glm::dot(e2, e2))));
    u = std::clamp(u, inside, 1.0), v = std::clamp(v, inside, 1.0);
    const double most = std::max(1.0, (u + v) * (1.0 + inside));
    u /= most, v /= most;
    constexpr double kSlant = 16.0;
    const glm::dvec3 place = a + u * e1 + v * e2;
    const double length2 = glm::dot(ray.direction, ray.direction),
                 closest = glm::dot(place, ray.direction) / length2,
                 off = std::sqrt(
                     glm::dot(place - closest * ray.direction, place - closest * ray.direction) /
                     length2);
    t = std::clamp(t, closest - kSlant * off, closest + kSlant * off);
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

// Corner i of kLanes triangles, sheared to the ray's frame.
struct Corners {
  VF x[3], y[3];
  VF depth[3];  // not yet in units of the ray's direction
};

// From a corner's distance to the origin, axes in the ray's order.
struct Vertex {
  VF x, y, depth;
};
HWY_INLINE Vertex shearVertex(const VF (&p)[3], const PreparedRay& ray) {
  const DF df;
  return {hn::Sub(p[0], hn::Mul(hn::Set(df, ray.shear[0]), p[2])),
          hn::Sub(p[1], hn::Mul(hn::Set(df, ray.shear[1]), p[2])), p[2]};
}

// The ray as boxes see it, axes in each block of four lanes: it meets a plane p (grid cells) that
// it may enter by at p * inverse - nearOffset or later, and one that it may leave by at p * inverse
// - farOffset or sooner. Boxes are wider by two cells, for the rounding of vertices (2^-24 of a
// triangle's extent) and of sums about p (2^-24 of the mesh's), and by 2^-21 of the origin's
// distance for its rounding; they end later by kBeyond, for that of both tests, which grows with
// the distance: 7 roundings of 2^-24 at each end. Behind the start that would be sooner: a ray that
// goes there has wider boxes.
struct BoxRay {
  VF inverse, nearOffset, farOffset;
  VF tnear;
  std::uint32_t nearPlane[3];
};
constexpr float kBeyond = 1.0f + 0x1p-17f;

HWY_INLINE BoxRay boxRay(const PreparedRay& ray) {
  const DF df;
  const VF origin =
      hn::Add(hn::ConvertTo(df, hn::LoadDup128(DI(), ray.cell)), hn::LoadDup128(df, ray.origin));
  const VF least = hn::Set(df, ray.tnear >= 0.0f ? 2.0f : 2.0f + 0x1p11f);
  BoxRay b;
  b.inverse = hn::LoadDup128(df, ray.inverse);
  const VF widen =
      hn::Mul(hn::MulAdd(hn::Abs(origin), hn::Set(df, 0x1p-21f), least), hn::Abs(b.inverse));
  const VF middle = hn::Mul(origin, b.inverse);
  b.nearOffset = hn::Add(middle, widen);
  b.farOffset = hn::Sub(middle, widen);
  b.tnear = hn::Set(df, ray.tnear);
  for (int k = 0; k < 3; ++k) b.nearPlane[k] = ray.nearPlane[k];
  return b;
}

// Which boxes are met between these distances; where they are entered goes to `entry`.
HWY_INLINE std::uint32_t boxesMet(VF tnear, VF tfar, float* entry) {
  const DF df;
  hn::StoreU(tnear, df, entry);
  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, hn::Le(tnear, hn::Mul(tfar, hn::Set(df, kBeyond))), lanes);
  return lanes[0];
}

// Where a ray that ends at `tfar` needs no more boxes.
HWY_INLINE float farEnd(float tfar) { return tfar * (tfar >= 0.0f ? kBeyond : 2.0f - kBeyond); }

// A BoxRay with a vector for each axis.
struct PlainRay {
  VF inverse[3], nearOffset[3], farOffset[3], tnear;
};

HWY_INLINE PlainRay plainRay(const PreparedRay& ray) {
  const BoxRay b = boxRay(ray);
  const auto axes = [](VF v, VF(&out)[3]) {
    out[0] = hn::Broadcast<0>(v), out[1] = hn::Broadcast<1>(v), out[2] = hn::Broadcast<2>(v);
  };
  PlainRay r;
  axes(b.inverse, r.inverse);
  axes(b.nearOffset, r.nearOffset), axes(b.farOffset, r.farOffset);
  r.tnear = b.tnear;
  return r;
}

// Which of kLanes boxes from `first`, by planes in cells, are met before `end`; where goes to
// `entry`.
HWY_INLINE std::uint32_t testPlainBoxes(const float* const (&near)[3], const float* const (&far)[3],
                                        std::size_t first, const PlainRay& r, VF end,
                                        float* entry) {
  VF from[3], to[3];
  for (int k = 0; k < 3; ++k) {
    from[k] = hn::MulSub(hn::Load(DF(), near[k] + first), r.inverse[k], r.nearOffset[k]);
    to[k] = hn::MulSub(hn::Load(DF(), far[k] + first), r.inverse[k], r.farOffset[k]);
  }
  return boxesMet(hn::Max(hn::Max(from[0], from[1]), hn::Max(from[2], r.tnear)),
                  hn::Min(hn::Min(to[0], to[1]), hn::Min(to[2], end)), entry);
}

struct Waiting {
  std::uint32_t child;
  float entry;
};

// Children that wait, with where their boxes are entered.
struct Stack {
  std::size_t waiting = 0;
  Waiting at[7 * TopLevel::kMaxDepth + 8];

  // Of the children of a node that are met, at least one: the nearest. The others wait, the nearest
  // of them on top. Any order does for kAny.
  template <bool kAny>
  HWY_INLINE std::uint32_t nearest(const std::uint32_t* child, const float* entry,
                                   std::uint32_t met) {
    auto first = static_cast<std::uint32_t>(std::countr_zero(met));
    met &= met - 1;
    if (met == 0) return child[first];
    auto second = static_cast<std::uint32_t>(std::countr_zero(met));
    met &= met - 1;
    if (!kAny) {
      const bool swap = entry[second] < entry[first];
      const std::uint32_t nearer = swap ? second : first;
      second = swap ? first : second;
      first = nearer;
    }
    const std::size_t base = waiting;
    at[waiting++] = {child[second], entry[second]};
    Waiting best{child[first], entry[first]};
    for (; met != 0; met &= met - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(met));
      Waiting other{child[i], entry[i]};
      if (!kAny && other.entry < best.entry) std::swap(other, best);
      std::size_t to = waiting++;
      for (; !kAny && to > base && at[to - 1].entry < other.entry; --to) at[to] = at[to - 1];
      at[to] = other;
    }
    return best.child;
  }
  // The next one that is entered before `end`. False if there is none.
  template <bool kAny>
  HWY_INLINE bool next(float end, std::uint32_t& child) {
    do {
      if (waiting == 0) return false;
      --waiting;
    } while (!kAny && at[waiting].entry > end);
    child = at[waiting].child;
    return true;
  }
};

struct Edges {
  VF u, v, w;
};

// Signs of edge functions that came out as zero in single precision: products of floats are exact
// in double, so is the sign of their difference.
inline HWY_NOINLINE Edges resolveZeros(VF x0, VF x1, VF x2, VF y0, VF y1, VF y2) {
  const DF df;
  alignas(32) float ax[kLanes], ay[kLanes], bx[kLanes], by[kLanes], cx[kLanes], cy[kLanes];
  alignas(32) float u[kLanes], v[kLanes], w[kLanes];
  hn::Store(x0, df, ax), hn::Store(y0, df, ay), hn::Store(x1, df, bx);
  hn::Store(y1, df, by), hn::Store(x2, df, cx), hn::Store(y2, df, cy);
  const auto edge = [](float px, float py, float qx, float qy) {
    return static_cast<float>(double(px) * double(qy) - double(py) * double(qx));
  };
  for (std::size_t i = 0; i < kLanes; ++i) {
    u[i] = edge(cx[i], cy[i], bx[i], by[i]);
    v[i] = edge(ax[i], ay[i], cx[i], cy[i]);
    w[i] = edge(bx[i], by[i], ax[i], ay[i]);
  }
  return {hn::Load(df, u), hn::Load(df, v), hn::Load(df, w)};
}

// How wrong t of single precision can be. Vertices are off by 2^-24 of (2 of their own distance,
// and 4 of their depth for the shears), so edge functions by 2^-24 (15 x^2 + 24 x z), for |x|, |y|
// <= x and depths <= z; weights are off by that over the determinant, and t by that times the range
// of depths, plus the rounding of depths and weighted sums, which is less than 2^-20 of the
// largest.
HWY_INLINE VF blurOf(const Corners& c, const VF (&along)[3], VF determinant,
                     const PreparedRay& ray) {
  const DF df;
  const auto most = [](const VF(&p)[3]) {
    return hn::Max(hn::Max(hn::Abs(p[0]), hn::Abs(p[1])), hn::Abs(p[2]));
  };
  const VF x = hn::Max(most(c.x), most(c.y));
  const VF z = most(along);
  const VF range = hn::Sub(hn::Max(hn::Max(along[0], along[1]), along[2]),
                           hn::Min(hn::Min(along[0], along[1]), along[2]));
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
HWY_NOINLINE bool takeNearest(const Leaf& leaf, std::uint32_t bits, VF t, VF u, VF v, VF blur,
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

// Of the triangles that the ray goes through.
template <bool kAny, typename Leaf>
HWY_INLINE bool takeInside(const Leaf& leaf, const Corners& c, const Edges& e, MF accept,
                           std::uint32_t first, PreparedRay& ray, Hit& hit) {
  const DF df;
  const VF determinant = hn::Add(hn::Add(e.u, e.v), e.w);
  accept = hn::And(accept, hn::Ne(determinant, hn::Zero(df)));
  const VF reciprocal = hn::Div(hn::Set(df, 1.0f), determinant);
  const VF u = hn::Mul(e.u, reciprocal), v = hn::Mul(e.v, reciprocal), w = hn::Mul(e.w, reciprocal);
  VF along[3];  // the ray, in units of its direction
  for (int i = 0; i < 3; ++i) along[i] = hn::Mul(hn::Set(df, ray.shear[2]), c.depth[i]);
  const VF t = hn::Add(hn::Add(hn::Mul(u, along[0]), hn::Mul(v, along[1])), hn::Mul(w, along[2]));
  const VF blur = blurOf(c, along, determinant, ray);
  const VF finite = hn::Set(df, std::numeric_limits<float>::max());
  accept =
      hn::And(accept, hn::And(hn::Ge(hn::Add(t, blur), hn::Set(df, ray.tnear)),
                              hn::Le(hn::Sub(t, blur), hn::Min(finite, hn::Set(df, ray.tfar)))));
  if (hn::AllFalse(df, accept)) return false;
  std::uint8_t lanes[8] = {};
  hn::StoreMaskBits(df, accept, lanes);
  return takeNearest<kAny>(leaf, lanes[0], t, v, w, blur, first, ray, hit);
}

// Watertight test [Woop et al. 2013] of the kLanes triangles of `active`; `first` is the place of
// the first. No multiply-add: an edge must give the exact negative when its ends are exchanged.
template <bool kAny, typename Leaf>
HWY_INLINE bool testTriangles(const Leaf& leaf, const Corners& c, MF active, std::uint32_t first,
                              PreparedRay& ray, Hit& hit) {
  const DF df;
  Edges e = {hn::Sub(hn::Mul(c.x[2], c.y[1]), hn::Mul(c.y[2], c.x[1])),
             hn::Sub(hn::Mul(c.x[0], c.y[2]), hn::Mul(c.y[0], c.x[2])),
             hn::Sub(hn::Mul(c.x[1], c.y[0]), hn::Mul(c.y[1], c.x[0]))};
  const VF zero = hn::Zero(df);
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
    e = resolveZeros(c.x[0], c.x[1], c.x[2], c.y[0], c.y[1], c.y[2]);
    accept = inside();
  }
  return takeInside<kAny>(leaf, c, e, accept, first, ray, hit);
}

struct ExpandedTriangles {
  const ExpandedLeaf* from;
  std::uint32_t number, cluster, ends;

  HWY_INLINE void readCorners(std::uint32_t place, glm::dvec3 (&p)[3]) const {
    for (int i = 0; i < 3; ++i) {
      const auto& c = from->corner[i];
      p[i] = glm::dvec3(c[0][place], c[1][place], c[2][place]);
    }
  }
};

// The corners of kLanes triangles from `first`. Cells of far origins are too many for a float.
HWY_INLINE Corners cornersOf(const ExpandedLeaf& leaf, std::uint32_t first,
                             const PreparedRay& ray) {
  const DF df;
  const DI di;
  Corners c;
  VF p[3][3];
  for (int i = 0; i < 3; ++i) {
    const int k = ray.axis[i];
    const VF origin = hn::Set(df, ray.origin[k]);
    for (int corner = 0; corner < 3; ++corner) {
      const VF grid = hn::Load(df, leaf.corner[corner][k] + first);
      const VF cells =
          HWY_LIKELY(!ray.isFar)
              ? hn::Sub(grid, hn::ConvertTo(df, hn::Set(di, ray.cell[k])))
              : hn::ConvertTo(df, hn::Sub(hn::ConvertTo(di, grid), hn::Set(di, ray.cell[k])));
      p[corner][i] = hn::Sub(cells, origin);
    }
  }
  for (int corner = 0; corner < 3; ++corner) {
    const Vertex v = shearVertex(p[corner], ray);
    c.x[corner] = v.x, c.y[corner] = v.y, c.depth[corner] = v.depth;
  }
  return c;
}

// Kept apart: it leaves registers to boxes.
template <bool kAny>
HWY_NOINLINE bool testExpandedLeaf(const ExpandedLeaf& leaf, PreparedRay& ray, Hit& hit) {
  const ExpandedTriangles triangles{&leaf, leaf.number, leaf.cluster,
                                    endsOn(ray, leaf.cluster, leaf.number)};
  bool found = false;
  for (std::uint32_t first = 0; first < leaf.triangles && !(kAny && found); first += kLanes)
    found |= testTriangles<kAny>(triangles, cornersOf(leaf, first, ray),
                                 hn::FirstN(DF(), std::uint32_t{leaf.triangles} - first), first,
                                 ray, hit);
  return found;
}

// Below, a Tracer knows a hierarchy of nodes, the first of them the root:
//
//   Boxes boxes(ray)                              the ray as its nodes see it
//   bool isNode(child)
//   const uint32* children(node)                  8 of them; 0 where there is none
//   uint32 testNode(node, boxes, end, entry)      which of them are met before `end`, and where
//   const float* planes(node, buffer)             of their boxes, by plane and child; in cells
//   bool testLeaf<kAny>(child, boxes, ray, hit)   as testTriangles()
//   void prefetch(child)

// Nearest first, from `child` on.
template <bool kAny, typename Tracer>
HWY_INLINE bool testFrom(const Tracer& tracer, std::uint32_t child, PreparedRay& ray, Hit& hit) {
  Stack stack;
  const typename Tracer::Boxes boxes = tracer.boxes(ray);
  float end = farEnd(ray.tfar);
  bool found = false;
  for (;;) {
    if (tracer.isNode(child)) {
      alignas(32) float entry[8];
      const std::uint32_t met = tracer.testNode(child, boxes, end, entry);
      if (met != 0) {
        const std::uint32_t* children = tracer.children(child);
        tracer.prefetch(children, met);
        child = stack.nearest<kAny>(children, entry, met);
        continue;
      }
    } else if (tracer.template testLeaf<kAny>(child, boxes, ray, hit)) {
      if (kAny) return true;
      found = true;
      end = farEnd(ray.tfar);
    }
    if (!stack.next<kAny>(end, child)) return found;
  }
}
template <bool kAny, typename Tracer>
HWY_NOINLINE bool testAlone(const Tracer& tracer, std::uint32_t child, PreparedRay& ray, Hit& hit) {
  return testFrom<kAny>(tracer, child, ray, hit);
}

// kLanes rays whose directions have the same signs: a node is opened once for all of them. Where
// few of them go on, each does so alone.
template <bool kAny, typename Tracer>
class Packet {
 public:
  Packet(const Tracer& tracer, PreparedRay* rays, Hit* hits)
      : tracer_(tracer), rays_(rays), hits_(hits) {
    alignas(32) float inverse[3][kLanes], near[3][kLanes], far[3][kLanes], tnear[kLanes];
    for (std::size_t i = 0; i < kLanes; ++i) {
      const PreparedRay& ray = rays[i];
      tnear[i] = ray.tnear;
      end_[i] = farEnd(ray.tfar);
      const float least = ray.tnear >= 0.0f ? 2.0f : 2.0f + 0x1p11f;
      for (int k = 0; k < 3; ++k) {  // as boxRay()
        const float origin = static_cast<float>(ray.cell[k]) + ray.origin[k];
        const float widen = (std::abs(origin) * 0x1p-21f + least) * std::abs(ray.inverse[k]);
        inverse[k][i] = ray.inverse[k];
        near[k][i] = origin * ray.inverse[k] + widen;
        far[k][i] = origin * ray.inverse[k] - widen;
      }
    }
    const DF df;
    for (int k = 0; k < 3; ++k) {
      inverse_[k] = hn::Load(df, inverse[k]);
      nearOffset_[k] = hn::Load(df, near[k]), farOffset_[k] = hn::Load(df, far[k]);
      nearPlane_[k] = rays[0].nearPlane[k];
    }
    tnear_ = hn::Load(df, tnear);
  }
  static bool suits(const PreparedRay* rays) {
    bool same = true;
    for (std::size_t i = 1; i < kLanes; ++i)
      for (int k = 0; k < 3; ++k) same &= rays[i].nearPlane[k] == rays[0].nearPlane[k];
    return same;
  }
  // Which rays have found something.
  std::uint32_t run() {
    Waiters here;
    here.child = 0;
    here.mask = (1u << kLanes) - 1u;
    for (;;) {
      if (std::popcount(here.mask) <= kFew) {
        for (std::uint32_t rest = here.mask; rest != 0; rest &= rest - 1) {
          const auto i = static_cast<std::uint32_t>(std::countr_zero(rest));
          take(i, testAlone<kAny>(tracer_, here.child, rays_[i], hits_[i]));
        }
      } else if (!tracer_.isNode(here.child)) {
        take(tracer_.template testLeaf<kAny>(here.child, here.mask, rays_, hits_));
      } else if (open(here.child, here.mask, here)) {
        continue;
      }
      if (!next(here)) return found_;
    }
  }

 private:
  static constexpr int kFew = 3;
  // Rays that wait for a child, and where each enters its box; the first of them stands for all
  // where the order is concerned.
  struct Waiters {
    alignas(32) float entry[kLanes];
    std::uint32_t child, mask;
    float key;
  };

  void take(std::uint32_t i, bool met) {
    if (!met) return;
    found_ |= 1u << i;
    end_[i] = kAny ? -std::numeric_limits<float>::infinity() : farEnd(rays_[i].tfar);
  }
  void take(std::uint32_t met) {
    for (; met != 0; met &= met - 1) take(static_cast<std::uint32_t>(std::countr_zero(met)), true);
  }
  // Puts children that are met on the stack, nearest on top, and takes that.
  HWY_INLINE bool open(std::uint32_t node, std::uint32_t mask, Waiters& here) {
    const DF df;
    alignas(32) float buffer[6][8];
    const float* planes = tracer_.planes(node, buffer[0]);
    const std::uint32_t* children = tracer_.children(node);
    const float *near[3], *far[3];
    for (int k = 0; k < 3; ++k)
      near[k] = planes + 8 * nearPlane_[k], far[k] = planes + 8 * (nearPlane_[k] ^ 1u);
    const VF end = hn::Load(df, end_);
    const std::size_t base = waiting_;
    for (std::uint32_t c = 0; c < 8 && children[c] != 0; ++c) {
      VF from[3], to[3];
      for (int k = 0; k < 3; ++k) {
        from[k] = hn::MulSub(hn::Set(df, near[k][c]), inverse_[k], nearOffset_[k]);
        to[k] = hn::MulSub(hn::Set(df, far[k][c]), inverse_[k], farOffset_[k]);
      }
      Waiters& at = waiters_[waiting_];
      at.mask = mask & boxesMet(hn::Max(hn::Max(from[0], from[1]), hn::Max(from[2], tnear_)),
                                hn::Min(hn::Min(to[0], to[1]), hn::Min(to[2], end)), at.entry);
      if (at.mask == 0) continue;
      at.child = children[c];
      at.key = at.entry[std::countr_zero(at.mask)];
      tracer_.prefetch(at.child);
      ++waiting_;
      if constexpr (!kAny) {
        for (std::size_t i = waiting_ - 1; i > base && waiters_[i - 1].key < waiters_[i].key; --i)
          std::swap(waiters_[i - 1], waiters_[i]);
      }
    }
    if (waiting_ == base) return false;
    here.child = waiters_[--waiting_].child;
    here.mask = waiters_[waiting_].mask;
    return true;
  }
  HWY_INLINE bool next(Waiters& here) {
    const DF df;
    while (waiting_ != 0) {
      const Waiters& top = waiters_[--waiting_];
      std::uint8_t lanes[8] = {};
      hn::StoreMaskBits(df, hn::Le(hn::Load(df, top.entry), hn::Load(df, end_)), lanes);
      here.child = top.child;
      here.mask = top.mask & lanes[0];
      if (here.mask != 0) return true;
    }
    return false;
  }

  const Tracer& tracer_;
  PreparedRay* rays_;
  Hit* hits_;
  VF inverse_[3], nearOffset_[3], farOffset_[3], tnear_;
  std::uint32_t nearPlane_[3];
  alignas(32) float end_[kLanes];  // of each ray
  std::uint32_t found_ = 0;
  std::size_t waiting_ = 0;
  Waiters waiters_[7 * TopLevel::kMaxDepth + 8];
};

template <typename Tracer>
HWY_INLINE void intersectSpan(const Tracer& tracer, std::span<PreparedRay> rays, Hit* hits) {
  std::size_t i = 0;
  while (i < rays.size()) {
    if (i + kLanes <= rays.size() && Packet<false, Tracer>::suits(&rays[i])) {
      Packet<false, Tracer>(tracer, &rays[i], hits + i).run();
      i += kLanes;
    } else {
      testAlone<false>(tracer, 0, rays[i], hits[i]);
      ++i;
    }
  }
}
template <typename Tracer>
HWY_INLINE void occludedSpan(const Tracer& tracer, std::span<const PreparedRay> rays,
                             std::uint8_t* blocked) {
  auto* all = const_cast<PreparedRay*>(rays.data());  // they stay as they are
  Hit none[kLanes];
  std::size_t i = 0;
  while (i < rays.size()) {
    if (i + kLanes <= rays.size() && Packet<true, Tracer>::suits(all + i)) {
      const std::uint32_t found = Packet<true, Tracer>(tracer, all + i, none).run();
      for (std::size_t lane = 0; lane < kLanes; ++lane) blocked[i + lane] = found >> lane & 1u;
      i += kLanes;
    } else {
      blocked[i] = testAlone<true>(tracer, 0, all[i], none[0]);
      ++i;
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#endif
