// The hierarchy over a mesh's clusters: nodes of up to 8 children with quantised boxes, after
// [Ylitie et al., Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs, HPG
// 2017].
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace hccm {

/// Inclusive bounds in grid cells; |coordinate| <= 2^24.
struct GridBox {
  std::int32_t lower[3], upper[3];

  static GridBox empty() {
    constexpr std::int32_t kLeast = std::numeric_limits<std::int32_t>::min(),
                           kMost = std::numeric_limits<std::int32_t>::max();
    return {{kMost, kMost, kMost}, {kLeast, kLeast, kLeast}};
  }
  void extend(const GridBox& o) {
    for (int k = 0; k < 3; ++k) {
      lower[k] = std::min(lower[k], o.lower[k]);
      upper[k] = std::max(upper[k], o.upper[k]);
    }
  }
  /// Half the surface, cells; a cell wider, so that flat boxes count.
  double area() const {
    if (lower[0] > upper[0]) return 0.0;
    double e[3];
    for (int k = 0; k < 3; ++k) e[k] = double(upper[k]) - double(lower[k]) + 1.0;
    return e[0] * e[1] + e[1] * e[2] + e[2] * e[0];
  }
};

/// A child's box is lower + planes * 2^(exponent - 127) along each axis, and holds all that is
/// below it.
struct alignas(32) TopNode {
  static constexpr std::uint32_t kCluster = 0x80000000u;  ///< flag of a child that is a cluster

  std::int32_t lower[3];
  std::uint8_t exponent[3], children;
  std::uint8_t planes[6][8];  ///< lower x, upper x, lower y, ...; by child
  std::uint32_t child[8];     ///< a node, or kCluster + a cluster
};
static_assert(sizeof(TopNode) == 96);

/// Immutable: threads may share it.
class TopLevel {
 public:
  static constexpr int kMaxDepth = 40;  ///< of nodes; a traversal needs a stack of 7 a level

  TopLevel() = default;
  /// By binned surface area heuristic. Box i is that of cluster i; at most 2^31 - 1 boxes. Needs 32
  /// bytes a box while it builds, and about 16 later.
  explicit TopLevel(std::span<const GridBox> boxes);

  /// The root first; none without boxes.
  std::span<const TopNode> nodes() const { return nodes_; }
  std::uint64_t bytes() const { return nodes_.size() * sizeof(TopNode); }

 private:
  std::vector<TopNode> nodes_;
};

}  // namespace hccm
