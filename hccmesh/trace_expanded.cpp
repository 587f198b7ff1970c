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

// As testExpandedLeaf(), of a leaf that the ray may not see, or pass.
template <bool kAny>
HWY_NOINLINE bool testSpecialLeaf(const MeshView& mesh, const ExpandedLeaf& leaf, PreparedRay& ray,
                                  Hit& hit) {
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(mesh.blob(leaf.cluster));
  return testAsSeen<kAny>(h, ray, [&] { return testExpandedLeaf<kAny>(leaf, ray, hit); });
}

// And where in a node its planes are, in floats.
struct ExpandedRay : PlainRay {
  std::size_t near[3], far[3];
};

struct ExpandedTracer {
  using Boxes = ExpandedRay;
  const MeshView& mesh;
  const ExpandedNode* nodes;
  const ExpandedLeaf* leaves;

  ExpandedTracer(const MeshView& view, const Expanded& expanded)
      : mesh(view), nodes(expanded.nodes().data()), leaves(expanded.leaves().data()) {}
  HWY_INLINE ExpandedRay boxes(const PreparedRay& ray) const {
    ExpandedRay r;
    static_cast<PlainRay&>(r) = plainRay(ray);
    for (int k = 0; k < 3; ++k)
      r.near[k] = std::size_t{8} * ray.nearPlane[k],
      r.far[k] = std::size_t{8} * (ray.nearPlane[k] ^ 1u);
    return r;
  }
  HWY_INLINE std::uint32_t testNode(std::uint32_t node, const ExpandedRay& ray, float end,
                                    float* entry) const {
    const float* planes = nodes[node].planes[0];
    const float *near[3], *far[3];
    for (int k = 0; k < 3; ++k) near[k] = planes + ray.near[k], far[k] = planes + ray.far[k];
    std::uint32_t met = 0;
    for (std::uint32_t first = 0; first < 8; first += kLanes)
      met |= testPlainBoxes(near, far, first, ray, hn::Set(DF(), end), entry + first) << first;
    return met;
  }
  HWY_INLINE const std::uint32_t* children(std::uint32_t node) const { return nodes[node].child; }
  HWY_INLINE bool isNode(std::uint32_t child) const { return !(child & ExpandedNode::kLeaf); }
  template <bool kAny>
  HWY_INLINE bool testLeaf(std::uint32_t child, const ExpandedRay&, PreparedRay& ray,
                           Hit& hit) const {
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
