#include "hccmesh/expanded.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"

namespace hccm {
namespace {

GridBox leafBoxOf(const ExpandedLeaf& leaf) {
  GridBox box = GridBox::empty();
  for (const auto& corner : leaf.corner) {
    for (int k = 0; k < 3; ++k) {
      const auto [least, most] = std::minmax_element(corner[k], corner[k] + leaf.triangles);
      box.lower[k] = std::min(box.lower[k], static_cast<std::int32_t>(*least));
      box.upper[k] = std::max(box.upper[k], static_cast<std::int32_t>(*most));
    }
  }
  return box;
}

}  // namespace

Expanded::Expanded(const Mesh& mesh) {
  std::uint32_t leaves = 0;
  firstLeaf_.reserve(mesh.clusterCount());
  for (std::uint32_t i = 0; i < mesh.clusterCount(); ++i) {
    firstLeaf_.push_back(leaves);
    leaves += mesh.clusterLeafCount(i);
  }
  leaves_.resize(leaves);
  tbb::parallel_for(std::uint32_t{0}, mesh.clusterCount(),
                    [&](std::uint32_t i) { expandCluster(mesh, i, firstLeaf_[i]); });
  makeNodes();
}

void Expanded::expandCluster(const Mesh& mesh, std::uint32_t cluster, std::size_t firstLeaf) {
  const std::byte* blob = mesh.clusterBytes(cluster).data();
  const auto& h = *reinterpret_cast<const layout::ClusterHeader*>(blob);
  std::int32_t grid[layout::kMaxVertices + 1][3];
  for (std::uint32_t v = 0; v < h.vertices(); ++v)
    layout::readVertex(blob + h.vertexOffset, h, v, grid[v]);
  for (std::uint32_t i = 0; i < h.leafCount; ++i) {
    const LeafTopology topology = readLeaf(blob + layout::recordOffset(blob, h, i));
    ExpandedLeaf& leaf = leaves_[firstLeaf + i];
    leaf = {.corner = {},
            .cluster = cluster,
            .number = static_cast<std::uint8_t>(i),
            .triangles = static_cast<std::uint8_t>(topology.triangles),
            .vertex = {}};
    for (int corner = 0; corner < 3; ++corner) {
      for (std::uint32_t t = 0; t < topology.triangles; ++t) {
        leaf.vertex[corner][t] = topology.vertex[topology.corner[corner][t]];
        const std::int32_t* at = grid[leaf.vertex[corner][t]];
        for (int k = 0; k < 3; ++k) leaf.corner[corner][k][t] = static_cast<float>(at[k]);
      }
    }
  }
}

/// The top level's hierarchy over leaves, with boxes as floats, which have all cells.
void Expanded::makeNodes() {
  std::vector<GridBox> boxes(leaves_.size());
  std::transform(leaves_.begin(), leaves_.end(), boxes.begin(), leafBoxOf);
  const TopLevel top(boxes);
  nodes_.resize(top.nodes().size());
  std::vector<GridBox> nodeBoxes(nodes_.size());
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (std::size_t n = nodes_.size(); n-- > 0;) {  // children come after their parents
    const TopNode& from = top.nodes()[n];
    ExpandedNode& to = nodes_[n];
    GridBox all = GridBox::empty();
    for (std::uint32_t i = 0; i < 8; ++i) {
      const bool there = i < from.children;
      const bool leaf = there && (from.child[i] & TopNode::kCluster) != 0;
      to.child[i] = there ? from.child[i] : 0;
      const GridBox box = !there ? GridBox::empty()
                          : leaf ? boxes[from.child[i] & ~TopNode::kCluster]
                                 : nodeBoxes[from.child[i]];
      for (int k = 0; k < 3; ++k) {
        to.planes[2 * k][i] = there ? static_cast<float>(box.lower[k]) : kInf;
        to.planes[2 * k + 1][i] = there ? static_cast<float>(box.upper[k]) : -kInf;
      }
      all.extend(box);
    }
    nodeBoxes[n] = all;
  }
}

}  // namespace hccm
