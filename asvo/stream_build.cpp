#include "asvo/stream_build.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <numeric>
#include <string>

#include "asvo/build_parts.h"

namespace asvo {
namespace {

/// Bytes of a triangle at hand: itself, and its place in lists.
constexpr std::uint64_t kTriangleBytes = sizeof(Triangle) + 24;

/// Part of the tree that is built at once.
struct Cell {
  int level;
  glm::vec3 corner;  ///< sub-voxels
  std::uint64_t key;
  std::vector<std::uint32_t> blocks;
};

struct Box {
  glm::vec3 lower, upper;
};

/// The triangles of a cell as the builder reads them.
class CellSource : public TriangleSource {
 public:
  CellSource(const BlockSource& blocks, const BlockSource::Reading& reading)
      : blocks_(blocks), reading_(reading) {}
  std::uint64_t count() const override { return reading_.triangles.size(); }
  void get(std::uint64_t i, Triangle& triangle) const override { triangle = reading_.triangles[i]; }
  Shade shade(const Triangle& triangle, float u, float v) const override {
    return blocks_.shade(triangle, reading_, u, v);
  }

 private:
  const BlockSource& blocks_;
  const BlockSource::Reading& reading_;
};

class BlockBuilder {
 public:
  BlockBuilder(const BlockSource& source, const Grid& grid, std::uint64_t mostTriangles)
      : source_(source), grid_(grid), most_(mostTriangles) {
    for (std::uint32_t b = 0; b < source.blockCount(); ++b) {
      Box box;
      source.bounds(b, box.lower, box.upper);
      // In sub-voxels, a little wider than the rounding of all tests.
      const glm::dvec3 margin(4.0 * grid.tolerance());
      boxes_.push_back({glm::vec3((glm::dvec3(box.lower) - grid.lower) * grid.scale() - margin),
                        glm::vec3((glm::dvec3(box.upper) - grid.lower) * grid.scale() + margin)});
    }
    Cell root{0, glm::vec3(0.0f), 0, std::vector<std::uint32_t>(boxes_.size())};
    std::iota(root.blocks.begin(), root.blocks.end(), 0u);
    split(std::move(root));
  }

  /// All leaves, by cell; false if there are more than maxLeaves.
  bool build(std::uint64_t maxLeaves, const std::function<bool(double)>& keepGoing,
             std::vector<LeafList>& lists) const {
    lists.assign(cells_.size(), {});
    std::atomic<std::uint64_t> leaves{0};
    std::atomic<std::size_t> done{0};
    std::atomic<bool> stopped{false};
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, cells_.size(), 1),
        [&](const tbb::blocked_range<std::size_t>& range) {
          for (std::size_t i = range.begin(); i < range.end(); ++i) {
            if (leaves > maxLeaves || stopped) return;
            // Waiting for nothing inside, a thread has one cell's triangles at a time.
            tbb::this_task_arena::isolate([&] { lists[i] = buildCell(cells_[i], maxLeaves); });
            leaves += lists[i].keys.size();
            if (!keepGoing(double(++done) / double(cells_.size()))) stopped = true;
          }
        },
        tbb::simple_partitioner());
    if (stopped) throw std::runtime_error("interrupted");
    return leaves <= maxLeaves;
  }

 private:
  float edgeOf(int level) const { return static_cast<float>(kSubVoxels << (grid_.depth - level)); }

  void split(Cell cell) {
    std::uint64_t triangles = 0;
    for (const std::uint32_t b : cell.blocks) triangles += source_.triangles(b);
    if (cell.blocks.empty()) return;
    if (triangles <= most_ || cell.level == grid_.depth) {
      cells_.push_back(std::move(cell));
      return;
    }
    const float half = edgeOf(cell.level + 1);
    for (int octant = 0; octant < 8; ++octant) {
      Cell child;
      child.level = cell.level + 1;
      child.corner = cell.corner + half * glm::vec3(octant & 1, octant >> 1 & 1, octant >> 2);
      child.key = cell.key << 3 | static_cast<std::uint64_t>(octant);
      for (const std::uint32_t b : cell.blocks)
        if (meets(boxes_[b], child.corner, half)) child.blocks.push_back(b);
      split(std::move(child));
    }
  }
  static bool meets(const Box& box, const glm::vec3& corner, float edge) {
    return glm::all(glm::lessThanEqual(box.lower, corner + edge)) &&
           glm::all(glm::lessThanEqual(corner, box.upper));
  }

  LeafList buildCell(const Cell& cell, std::uint64_t maxLeaves) const {
    const float edge = edgeOf(cell.level);
    const double margin = 4.0 * grid_.tolerance();
    const glm::vec3 lower((glm::dvec3(cell.corner) - margin) / grid_.scale() + grid_.lower);
    const glm::vec3 upper((glm::dvec3(cell.corner + edge) + margin) / grid_.scale() + grid_.lower);
    BlockSource::Reading reading;
    if (cell.level == grid_.depth) return buildLeaf(cell, lower, upper);
    for (const std::uint32_t b : cell.blocks) source_.read(b, lower, upper, reading);
    if (reading.triangles.empty()) return {};
    std::vector<std::uint32_t> list;
    for (std::uint32_t i = 0; i < reading.triangles.size(); ++i) {
      if (isBuildable(reading.triangles[i])) list.push_back(i);
    }
    const CellSource source(source_, reading);
    return buildSubTree(source, grid_, maxLeaves, cell.level, cell.corner, cell.key,
                        std::move(list));
  }

  /// One leaf of any number of triangles, block by block.
  LeafList buildLeaf(const Cell& cell, const glm::vec3& lower, const glm::vec3& upper) const {
    LeafList out;
    BlockSource::Reading reading;
    const CellSource source(source_, reading);
    LeafBuilder leaf(source, grid_);
    leaf.start(cell.corner);
    for (const std::uint32_t b : cell.blocks) {
      reading.clear();
      source_.read(b, lower, upper, reading);
      for (const Triangle& t : reading.triangles) {
        if (isBuildable(t)) leaf.add(GridTriangle(t, grid_), TriangleBox::kAllGroups);
      }
    }
    leaf.finish(cell.key, out);
    return out;
  }

  const BlockSource& source_;
  const Grid& grid_;
  std::uint64_t most_;
  std::vector<Box> boxes_;
  std::vector<Cell> cells_;  ///< in Morton order
};

Grid gridOf(const BlockSource& source, int depth) {
  glm::dvec3 lower(1e300), upper(-1e300);
  for (std::uint32_t b = 0; b < source.blockCount(); ++b) {
    glm::vec3 l, u;
    source.bounds(b, l, u);
    lower = glm::min(lower, glm::dvec3(l));
    upper = glm::max(upper, glm::dvec3(u));
  }
  return gridAround(lower, upper, depth);
}

}  // namespace

Tree buildFromBlocks(const BlockSource& source, const StreamBuildOptions& options) {
  const BuildOptions& tree = options.tree;
  if (tree.depth < 0 || tree.depth > static_cast<int>(ASVO_MAX_DEPTH))
    throw std::invalid_argument("asvo: depth must lie in 0.." + std::to_string(ASVO_MAX_DEPTH));
  constexpr std::uint64_t kMostLeaves = 1ull << 28;
  std::uint64_t maxLeaves = std::min(tree.maxLeaves, kMostLeaves);
  if (tree.maxBytes > 0) maxLeaves = std::min(maxLeaves, tree.maxBytes / kBytesPerLeaf);
  const auto threads = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
  const std::uint64_t most =
      std::max<std::uint64_t>(options.memoryBytes / threads / kTriangleBytes, 16'384);
  const int wanted = tree.depth > 0 ? tree.depth : 8;
  Grid grid = gridOf(source, wanted);
  bool deepen = tree.deepen;
  for (;; --grid.depth) {
    const bool last = grid.depth == 1;
    std::vector<LeafList> lists;
    const BlockBuilder builder(source, grid, most);
    if (!builder.build(last ? kMostLeaves : maxLeaves, options.keepGoing, lists)) continue;
    const bool any = std::any_of(lists.begin(), lists.end(),
                                 [](const LeafList& list) { return !list.keys.empty(); });
    if (!any) return emptyTree(grid);
    Tree out = assemble(lists, grid);
    if (!last && tree.maxBytes > 0 && bytesOf(out) > tree.maxBytes) continue;
    const bool whole = deepen && grid.depth == wanted;
    const int more = whole ? levelsToDeepen(out.leaves.size(), wanted) : 0;
    if (more == 0) return out;
    deepen = false;
    grid.depth += more + 1;
  }
}

}  // namespace asvo
