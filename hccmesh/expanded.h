// A mesh once more, as the test of a ray wants it: for meshes whose memory does not matter beside
// their speed. Made by Mesh::expand().
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "hccmesh/top_level.h"

namespace hccm {

class Mesh;

/// Up to 8 triangles of a cluster.
struct alignas(64) ExpandedLeaf {
  float corner[3][3][8];  ///< grid cells: by corner, axis, triangle
  std::uint32_t cluster;
  std::uint8_t number, triangles;  ///< number: of the leaf in its cluster
  std::uint8_t vertex[3][8];       ///< of the cluster: by corner, triangle
};
static_assert(sizeof(ExpandedLeaf) == 320);

/// Boxes of up to 8 children, grid cells. What is not there has an empty one.
struct alignas(32) ExpandedNode {
  static constexpr std::uint32_t kLeaf = 0x80000000u;  ///< flag of a child that is a leaf

  float planes[6][8];      ///< lower x, upper x, lower y, ...; by child
  std::uint32_t child[8];  ///< a node, or kLeaf + a leaf
};
static_assert(sizeof(ExpandedNode) == 224);

/// Immutable: threads may share it.
class Expanded {
 public:
  /// Copies the corners of a valid mesh and nothing else: its clusters are still needed for what a
  /// ray sees and for attributes. About 360 bytes a leaf.
  explicit Expanded(const Mesh& mesh);

  std::span<const ExpandedNode> nodes() const { return nodes_; }  ///< the root first
  std::span<const ExpandedLeaf> leaves() const { return leaves_; }
  const ExpandedLeaf& leaf(std::uint32_t cluster, std::uint32_t number) const {
    return leaves_[firstLeaf_[cluster] + number];
  }
  std::uint64_t bytes() const {
    return nodes_.size() * sizeof(ExpandedNode) + leaves_.size() * sizeof(ExpandedLeaf) +
           firstLeaf_.size() * sizeof(std::uint32_t);
  }

 private:
  void expandCluster(const Mesh& mesh, std::uint32_t cluster, std::size_t firstLeaf);
  void makeNodes();

  std::vector<ExpandedNode> nodes_;
  std::vector<ExpandedLeaf> leaves_;
  std::vector<std::uint32_t> firstLeaf_;  ///< by cluster
};

}  // namespace hccm
