// A ray against an expanded mesh: 8 boxes at once, then 8 triangles at once. The same bits as of
// the compressed one (trace.cpp): vertices reach the test as the same numbers.
#include "hccmesh/trace.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hccmesh/trace_expanded.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "hccmesh/trace-inl.h"

HWY_BEFORE_NAMESPACE();
namespace hccm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

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
                                 hn::FirstN(DF(), leaf.triangles - first), first, ray, hit);
  return found;
}

// As testExpandedLeaf(), of a leaf that the ray may not see, or pass.
template <bool kAny>
HWY_NOINLINE bool testSpecialLeaf(const MeshView& mesh, const ExpandedLeaf& leaf, PreparedRay& ray,
                                  Hit& hit) {
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(mesh.blob(leaf.cluster));
  return testAsSeen<kAny>(h, ray, [&] { return testExpandedLeaf<kAny>(leaf, ray, hit); });
}

// A BoxRay with a vector for each axis, and where in a node its planes are, in floats.
struct PlainRay {
  VF inverse[3], nearOffset[3], farOffset[3], tnear;
  std::size_t near[3], far[3];
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
  for (int k = 0; k < 3; ++k)
    r.near[k] = std::size_t{8} * b.nearPlane[k], r.far[k] = std::size_t{8} * (b.nearPlane[k] ^ 1u);
  return r;
}

// Which of kLanes children from `first` are met before `end`; where goes to `entry`.
HWY_INLINE std::uint32_t testPlainBoxes(const ExpandedNode& node, std::uint32_t first,
                                        const PlainRay& r, VF end, float* entry) {
  VF from[3], to[3];
  for (int k = 0; k < 3; ++k) {
    const float* planes = node.planes[0] + first;
    from[k] = hn::MulSub(hn::Load(DF(), planes + r.near[k]), r.inverse[k], r.nearOffset[k]);
    to[k] = hn::MulSub(hn::Load(DF(), planes + r.far[k]), r.inverse[k], r.farOffset[k]);
  }
  return boxesMet(hn::Max(hn::Max(from[0], from[1]), hn::Max(from[2], r.tnear)),
                  hn::Min(hn::Min(to[0], to[1]), hn::Min(to[2], end)), entry);
}

struct ExpandedTracer {
  using Boxes = PlainRay;
  const MeshView& mesh;
  const ExpandedNode* nodes;
  const ExpandedLeaf* leaves;

  ExpandedTracer(const MeshView& view, const Expanded& expanded)
      : mesh(view), nodes(expanded.nodes().data()), leaves(expanded.leaves().data()) {}
  HWY_INLINE PlainRay boxes(const PreparedRay& ray) const { return plainRay(ray); }
  HWY_INLINE std::uint32_t testNode(std::uint32_t node, const PlainRay& ray, float end,
                                    float* entry) const {
    std::uint32_t met = 0;
    for (std::uint32_t first = 0; first < 8; first += kLanes)
      met |= testPlainBoxes(nodes[node], first, ray, hn::Set(DF(), end), entry + first) << first;
    return met;
  }
  HWY_INLINE const std::uint32_t* children(std::uint32_t node) const { return nodes[node].child; }
  HWY_INLINE bool isNode(std::uint32_t child) const { return !(child & ExpandedNode::kLeaf); }
  template <bool kAny>
  HWY_INLINE bool testLeaf(std::uint32_t child, const PlainRay&, PreparedRay& ray, Hit& hit) const {
    return testAt<kAny>(leaves[child & ~ExpandedNode::kLeaf], ray, hit);
  }
  // As testLeaf() for some of kLanes rays.
  template <bool kAny>
  HWY_INLINE std::uint32_t testLeaf(std::uint32_t child, std::uint32_t mask, PreparedRay* rays,
                                    Hit* hits) const {
    std::uint32_t met = 0;
    for (; mask != 0; mask &= mask - 1) {
      const int i = std::countr_zero(mask);
      if (testAt<kAny>(leaves[child & ~ExpandedNode::kLeaf], rays[i], hits[i])) met |= 1u << i;
    }
    return met;
  }
  HWY_INLINE const float* planes(std::uint32_t node, float*) const { return nodes[node].planes[0]; }
  // Small meshes are in a cache already.
  HWY_INLINE void prefetch(std::uint32_t) const {}
  HWY_INLINE void prefetch(const std::uint32_t*, std::uint32_t) const {}

 private:
  template <bool kAny>
  HWY_INLINE bool testAt(const ExpandedLeaf& leaf, PreparedRay& ray, Hit& hit) const {
    const bool special = ray.hidden != nullptr || (kAny && ray.passages != nullptr);
    return special ? testSpecialLeaf<kAny>(mesh, leaf, ray, hit)
                   : testExpandedLeaf<kAny>(leaf, ray, hit);
  }
};

bool intersectExpanded(const MeshView& mesh, const Expanded& expanded, PreparedRay& ray, Hit& hit) {
  return testFrom<false>(ExpandedTracer(mesh, expanded), 0, ray, hit);
}
bool occludedExpanded(const MeshView& mesh, const Expanded& expanded, const PreparedRay& ray) {
  Hit none;
  return testFrom<true>(ExpandedTracer(mesh, expanded), 0, const_cast<PreparedRay&>(ray),
                        none);  // it stays as it is
}
void intersectExpandedSpan(const MeshView& mesh, const Expanded& expanded,
                           std::span<PreparedRay> rays, Hit* hits) {
  intersectSpan(ExpandedTracer(mesh, expanded), rays, hits);
}
void occludedExpandedSpan(const MeshView& mesh, const Expanded& expanded,
                          std::span<const PreparedRay> rays, std::uint8_t* blocked) {
  occludedSpan(ExpandedTracer(mesh, expanded), rays, blocked);
}
const ExpandedKernels* expandedKernels() {
  static const ExpandedKernels all = {intersectExpanded, occludedExpanded, intersectExpandedSpan,
                                      occludedExpandedSpan};
  return &all;
}

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hccm {
HWY_EXPORT(expandedKernels);
const ExpandedKernels* chooseExpandedKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(expandedKernels)();
}
}  // namespace hccm
#endif
