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

// One corner of kLanes triangles from `first`.
HWY_INLINE Vertex cornerOf(const ExpandedLeaf& leaf, std::uint32_t corner, std::uint32_t first,
                           const PreparedRay& ray) {
  const DF df;
  const DI di;
  VF p[3];
  for (int i = 0; i < 3; ++i) {
    const int k = ray.axis[i];
    const auto grid =
        hn::Sub(hn::Load(di, leaf.corner[corner][k] + first), hn::Set(di, ray.cell[k]));
    p[i] = hn::Sub(hn::ConvertTo(df, grid), hn::Set(df, ray.origin[k]));
  }
  return shearVertex(p, ray);
}

template <bool kAny>
HWY_INLINE bool testExpandedLeaf(const ExpandedLeaf& leaf, PreparedRay& ray, Hit& hit) {
  const ExpandedTriangles triangles{&leaf, leaf.number, leaf.cluster,
                                    endsOn(ray, leaf.cluster, leaf.number)};
  bool found = false;
  for (std::uint32_t first = 0; first < leaf.triangles && !(kAny && found); first += kLanes)
    found |=
        testTriangles<kAny>(triangles, cornerOf(leaf, 0, first, ray), cornerOf(leaf, 1, first, ray),
                            cornerOf(leaf, 2, first, ray), leaf.triangles - first, first, ray, hit);
  return found;
}

// As testExpandedLeaf(), of a leaf that the ray may not see, or pass.
template <bool kAny>
HWY_NOINLINE bool testSpecialLeaf(const MeshView& mesh, const ExpandedLeaf& leaf, PreparedRay& ray,
                                  Hit& hit) {
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(mesh.blob(leaf.cluster));
  return testAsSeen<kAny>(h, ray, [&] { return testExpandedLeaf<kAny>(leaf, ray, hit); });
}

// The ray in the frame of boxes: a plane p is met at (p - origin) * inverse, less or more `widen`.
// That is a cell, for the rounding of vertices, and the rounding of the origin; see openBoxes() in
// trace.cpp.
struct PlainFrame {
  float origin[3], widen[3];
};

HWY_INLINE PlainFrame plainFrame(const PreparedRay& ray) {
  PlainFrame f;
  for (int k = 0; k < 3; ++k) {
    f.origin[k] = static_cast<float>(ray.cell[k]) + ray.origin[k];
    f.widen[k] = (1.0f + std::abs(f.origin[k]) * 0x1p-22f) * std::abs(ray.inverse[k]);
  }
  return f;
}

// Which of kLanes children from `first` are met; their entry distances go to `entry`.
HWY_INLINE std::uint32_t testPlainBoxes(const ExpandedNode& node, std::uint32_t first,
                                        const PlainFrame& f, const PreparedRay& ray, float* entry) {
  const DF df;
  VF tnear = hn::Set(df, ray.tnear), tfar = hn::Set(df, ray.tfar);
  for (int k = 0; k < 3; ++k) {
    const VF origin = hn::Set(df, f.origin[k]), inverse = hn::Set(df, ray.inverse[k]),
             widen = hn::Set(df, f.widen[k]);
    const VF from = hn::Sub(hn::Load(df, node.planes[ray.nearPlane[k]] + first), origin),
             to = hn::Sub(hn::Load(df, node.planes[ray.nearPlane[k] ^ 1u] + first), origin);
    tnear = hn::Max(tnear, hn::MulSub(from, inverse, widen));
    tfar = hn::Min(tfar, hn::MulAdd(to, inverse, widen));
  }
  return boxesMet(tnear, tfar, entry);
}

// Nearest first. Children wait on a stack with the distance of their boxes.
template <bool kAny>
HWY_INLINE bool testExpanded(const MeshView& mesh, const Expanded& expanded, PreparedRay& ray,
                             Hit& hit) {
  struct Waiting {
    std::uint32_t child;
    float entry;
  };
  Waiting stack[7 * TopLevel::kMaxDepth + 8];
  const ExpandedNode* nodes = expanded.nodes().data();
  const ExpandedLeaf* leaves = expanded.leaves().data();
  const PlainFrame frame = plainFrame(ray);
  const bool special = ray.hidden != nullptr || (kAny && ray.passages != nullptr);
  std::size_t waiting = 0;
  bool found = false;
  std::uint32_t child = 0;
  for (;;) {
    while (!(child & ExpandedNode::kLeaf)) {
      const ExpandedNode& node = nodes[child];
      alignas(32) float entry[8];
      std::uint32_t met = 0;
      for (std::uint32_t first = 0; first < 8; first += kLanes)
        met |= testPlainBoxes(node, first, frame, ray, entry + first) << first;
      if (met == 0) goto next;
      child = node.child[std::countr_zero(met)];
      float nearest = entry[std::countr_zero(met)];
      const std::size_t base = waiting;
      for (met &= met - 1; met != 0; met &= met - 1) {
        const auto i = static_cast<std::uint32_t>(std::countr_zero(met));
        Waiting other{node.child[i], entry[i]};
        if (!kAny && other.entry < nearest) {
          std::swap(other.child, child);
          std::swap(other.entry, nearest);
        }
        std::size_t at = waiting++;
        for (; !kAny && at > base && stack[at - 1].entry < other.entry; --at)
          stack[at] = stack[at - 1];
        stack[at] = other;
      }
    }
    {
      const ExpandedLeaf& leaf = leaves[child & ~ExpandedNode::kLeaf];
      found |= special ? testSpecialLeaf<kAny>(mesh, leaf, ray, hit)
                       : testExpandedLeaf<kAny>(leaf, ray, hit);
      if (kAny && found) return true;
    }
  next:
    do {
      if (waiting == 0) return found;
      --waiting;
    } while (!kAny && stack[waiting].entry > ray.tfar);
    child = stack[waiting].child;
  }
}

bool intersectExpanded(const MeshView& mesh, const Expanded& expanded, PreparedRay& ray, Hit& hit) {
  return testExpanded<false>(mesh, expanded, ray, hit);
}
bool occludedExpanded(const MeshView& mesh, const Expanded& expanded, const PreparedRay& ray) {
  Hit hit;
  return testExpanded<true>(mesh, expanded, const_cast<PreparedRay&>(ray), hit);  // it stays
}
ExpandedKernels expandedKernels() { return {intersectExpanded, occludedExpanded}; }

}  // namespace HWY_NAMESPACE
}  // namespace hccm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hccm {
HWY_EXPORT(expandedKernels);
ExpandedKernels chooseExpandedKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(expandedKernels)();
}
}  // namespace hccm
#endif
