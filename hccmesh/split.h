// Which triangles share a cluster and which a leaf: top down by the surface area heuristic.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "hccmesh/layout.h"

namespace hccm {

/// One triangle to be placed: its bounds in grid cells (exact in float) and where it comes from.
struct alignas(16) Reference {
  float lower[3];
  std::uint32_t source;  ///< index of its part
  float upper[3];
  std::uint32_t triangle;  ///< index in its part
};
static_assert(sizeof(Reference) == 32);

struct Range {
  std::size_t begin, end;
};

/// Orders references so that pieces of at most `pieceSize` lie together; returns these from left to
/// right. Equal for any number of threads (oneTBB).
inline constexpr std::size_t kPieceSize = 2048;
std::vector<Range> splitIntoPieces(std::span<Reference> references,
                                   std::size_t pieceSize = kPieceSize);

/// How large clusters and leaves get; the format's by default.
struct SplitLimits {
  std::size_t triangles = layout::kMaxTriangles, vertices = layout::kMaxVertices;
  std::size_t leaves = layout::kMaxLeaves;
  std::size_t spareLeaves = 8;  ///< one leaf in so many more than full ones would need
};

/// Splits one piece exactly: triangles are sorted along each axis once and every position is tried.
class PieceSplitter {
 public:
  explicit PieceSplitter(std::span<const Reference> piece, const SplitLimits& limits = {});

  using Index = std::uint16_t;
  /// Whether some triangles can be one leaf.
  using Fits = std::function<bool(std::span<const Index>)>;
  /// The next cluster from the left, if any.
  bool nextCluster(Range& cluster);
  /// Halves a cluster that had too many vertices or leaves; its parts come up in nextCluster()
  /// again.
  void refuse(const Range& cluster);
  /// Orders a cluster leaf by leaf; returns the first triangle of each. A leaf has up to kLeafSize
  /// triangles that fit together; one alone must.
  std::vector<std::uint16_t> splitIntoLeaves(const Range& cluster, const Fits& fits);
  /// Triangles of a range, as indices into the piece.
  std::span<const Index> triangles(const Range& range) const {
    return std::span(order_[0]).subspan(range.begin, range.end - range.begin);
  }

 private:
  struct Split {
    int axis = 0;
    std::size_t position = 0;
  };
  template <typename Cost>
  Split bestSplit(const Range& range, std::size_t stride, const Cost& cost);
  void partition(const Range& range, const Split& split);
  void splitLeaves(const Range& range, std::size_t budget, std::size_t base, const Fits& fits,
                   std::vector<std::uint16_t>& starts);

  std::span<const Reference> piece_;
  SplitLimits limits_;
  std::array<std::vector<Index>, 3> order_;  ///< by centroid along x, y, z within each range
  std::vector<Index> scratch_;
  std::vector<float> areas_;
  std::vector<std::uint8_t> side_;
  std::vector<Range> pending_;  ///< a stack, leftmost range on top
};

}  // namespace hccm
