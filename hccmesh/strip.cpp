#include "hccmesh/strip.h"

#include <algorithm>

namespace hccm {
namespace {

constexpr std::uint32_t kMaxLocal = 3 * layout::kLeafSize;
constexpr std::uint8_t kNone = 0xff;

// Triangles over local vertex numbers, and which triangle has a directed edge.
struct LocalTriangles {
  std::uint32_t count = 0, vertices = 0;
  std::uint8_t corner[layout::kLeafSize][3];
  std::uint16_t global[kMaxLocal];
  std::uint8_t ofEdge[kMaxLocal][kMaxLocal];
  std::uint8_t neighbours[layout::kLeafSize] = {};

  explicit LocalTriangles(std::span<const Corners> triangles)
      : count(static_cast<std::uint32_t>(triangles.size())) {
    for (std::uint32_t t = 0; t < count; ++t)
      for (int k = 0; k < 3; ++k) {
        const std::uint16_t* end = global + vertices;
        const std::uint16_t* at = std::find(static_cast<const std::uint16_t*>(global), end,
                                            triangles[t][static_cast<std::size_t>(k)]);
        if (at == end) global[vertices++] = triangles[t][static_cast<std::size_t>(k)];
        corner[t][k] = static_cast<std::uint8_t>(at - global);
      }
    for (std::uint32_t v = 0; v < vertices; ++v) std::fill_n(ofEdge[v], vertices, kNone);
    for (std::uint32_t t = 0; t < count; ++t)
      for (int k = 0; k < 3; ++k)
        ofEdge[corner[t][k]][corner[t][(k + 1) % 3]] = static_cast<std::uint8_t>(t);
    for (std::uint32_t t = 0; t < count; ++t)
      for (int k = 0; k < 3; ++k)
        if (ofEdge[corner[t][(k + 1) % 3]][corner[t][k]] != kNone) ++neighbours[t];
  }
  /// Which corner a strip of this triangle starts with to go on over its (last) shared edge.
  int rotationTowardsNeighbour(std::uint32_t t) const {
    for (int k = 2; k > 0; --k)
      if (ofEdge[corner[t][(k + 2) % 3]][corner[t][(k + 1) % 3]] != kNone) return k;
    return 0;
  }
};

// One strip while it grows.
class Growing {
 public:
  Growing(const LocalTriangles& in, std::uint32_t first, int rotation)
      : in_(in), left_((1u << in.count) - 1u) {
    const std::uint8_t* c = in.corner[first];
    put(c[rotation]), put(c[(rotation + 1) % 3]);
    take(first, c[(rotation + 2) % 3]);
  }
  /// False as soon as it is not shorter than `limit` entries.
  bool grow(std::uint32_t limit) {
    while (left_ != 0) {
      if (size + static_cast<std::uint32_t>(std::popcount(left_)) >= limit) return false;
      const std::uint8_t next = continued(entry[size - 2], entry[size - 1], size);
      if (next != kNone)
        take(next, thirdCorner(next, entry[size - 2], entry[size - 1]));
      else
        turn();
      if (size > layout::kMaxEntries) return false;
    }
    return size < limit;
  }
  std::uint8_t entry[layout::kMaxEntries + 3];
  std::uint32_t size = 0, starts = 0;

 private:
  void put(std::uint8_t vertex) { entry[size++] = vertex; }
  void take(std::uint32_t triangle, std::uint8_t last) {
    put(last);
    starts |= 1u << (size - 3);
    left_ &= ~(1u << triangle);
  }
  // The triangle that one more entry adds to a strip of `length` that ends with u, v.
  std::uint8_t continued(std::uint8_t u, std::uint8_t v, std::uint32_t length) const {
    const std::uint8_t t = length % 2 == 0 ? in_.ofEdge[u][v] : in_.ofEdge[v][u];
    return t != kNone && (left_ >> t & 1u) ? t : kNone;
  }
  std::uint8_t thirdCorner(std::uint32_t t, std::uint8_t u, std::uint8_t v) const {
    for (std::uint8_t c : in_.corner[t])
      if (c != u && c != v) return c;
    return in_.corner[t][2];
  }
  // Begins anew at the last entry if a triangle has it, else three entries on; best where the strip
  // will go on.
  void turn() {
    std::uint32_t best = 0, leastCost = 100;
    std::uint8_t order[3] = {};
    for (std::uint32_t rest = left_; rest != 0; rest &= rest - 1) {
      const auto t = static_cast<std::uint32_t>(std::countr_zero(rest));
      for (std::uint32_t r = 0; r < 3; ++r) {
        const std::uint8_t a = in_.corner[t][r], b = in_.corner[t][(r + 1) % 3],
                           c = in_.corner[t][(r + 2) % 3];
        const bool shared = a == entry[size - 1];
        const std::uint32_t start = shared ? size - 1 : size;
        const std::uint8_t x = start % 2 == 0 ? b : c, y = start % 2 == 0 ? c : b;
        const std::uint8_t next = continued(x, y, start + 3);
        const std::uint32_t cost = (shared ? 4u : 6u) - (next != kNone && next != t ? 1u : 0u);
        if (cost >= leastCost) continue;
        leastCost = cost, best = t;
        order[0] = a, order[1] = x, order[2] = y;
      }
    }
    if (leastCost > 4) put(order[0]);
    put(order[1]);
    if (size + 1 <= layout::kMaxEntries)
      take(best, order[2]);
    else
      size = layout::kMaxEntries + 1;
  }

  const LocalTriangles& in_;
  std::uint32_t left_;
};

}  // namespace

bool makeStrip(std::span<const Corners> triangles, Strip& out) {
  const LocalTriangles in(triangles);
  std::uint32_t least = layout::kMaxEntries + 1;
  const auto tryFrom = [&](std::uint32_t first, int rotation) {
    if (least <= in.count + 2) return;
    Growing strip(in, first, rotation);
    if (!strip.grow(least)) return;
    least = strip.size;
    out.size = strip.size;
    out.starts = strip.starts;
    for (std::uint32_t i = 0; i < strip.size; ++i) out.entries[i] = in.global[strip.entry[i]];
  };
  // Strips end where triangles have few neighbours, and go on there over the only shared edge;
  // elsewhere is tried if that fails.
  for (std::uint32_t first = 0; first < in.count; ++first)
    if (in.neighbours[first] <= 1) tryFrom(first, in.rotationTowardsNeighbour(first));
  for (std::uint32_t first = 0; first < in.count && least > layout::kMaxEntries; ++first)
    for (int rotation = 0; rotation < 3; ++rotation) tryFrom(first, rotation);
  return least <= layout::kMaxEntries;
}

}  // namespace hccm
