// The tests of a ray against one cluster and a whole mesh, for the best instruction set of this
// processor.
#pragma once

#include <span>

#include "hccmesh/expanded.h"
#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/top_level.h"

namespace hccm {

/// Where the parts of a mesh lie. There is at least one node.
struct MeshView {
  const TopNode* nodes;
  const std::byte* bytes;
  const std::uint32_t* table;

  const std::byte* blob(std::uint32_t cluster) const {
    return bytes + layout::blobOffset(table[cluster]);
  }
  /// Asks for what a visit of a node or cluster reads first.
  void prefetch(std::uint32_t child) const {
    const bool isCluster = (child & TopNode::kCluster) != 0;
    const std::byte* at = isCluster ? blob(child & ~TopNode::kCluster)
                                    : reinterpret_cast<const std::byte*>(nodes + child);
    __builtin_prefetch(at);
    __builtin_prefetch(at + 64);
    if (!isCluster) return;
    __builtin_prefetch(at + 128);
    __builtin_prefetch(at + 192);
  }
};

struct Kernels {
  bool (*intersect)(const std::byte* blob, PreparedRay& ray, std::uint32_t cluster, Hit& hit);
  bool (*occluded)(const std::byte* blob, const PreparedRay& ray, std::uint32_t cluster);
  bool (*intersectMesh)(const MeshView& mesh, PreparedRay& ray, Hit& hit);
  bool (*occludedMesh)(const MeshView& mesh, const PreparedRay& ray);
  void (*intersectSpan)(const MeshView& mesh, std::span<PreparedRay> rays, Hit* hits);
  void (*occludedSpan)(const MeshView& mesh, std::span<const PreparedRay> rays,
                       std::uint8_t* blocked);
  /// The corners of a leaf's triangle: numbers of the cluster's vertices.
  void (*corners)(const std::byte* record, std::uint32_t place, std::uint32_t* vertex);
  const char* name;  ///< of the instruction set
};

struct ExpandedKernels {
  bool (*intersect)(const MeshView& mesh, const Expanded& expanded, PreparedRay& ray, Hit& hit);
  bool (*occluded)(const MeshView& mesh, const Expanded& expanded, const PreparedRay& ray);
  void (*intersectSpan)(const MeshView& mesh, const Expanded& expanded, std::span<PreparedRay> rays,
                        Hit* hits);
  void (*occludedSpan)(const MeshView& mesh, const Expanded& expanded,
                       std::span<const PreparedRay> rays, std::uint8_t* blocked);
};

/// Both obey hwy::SetSupportedTargetsForTest. Thread safe.
const Kernels* chooseKernels();
const ExpandedKernels* chooseExpandedKernels();

}  // namespace hccm
