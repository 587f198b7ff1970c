// The builder: triangles are spread over cells of a coarse level (buckets); each bucket is then
// built on its own, top down, with the list of triangles that touch each cell. A list keeps the
// order of the source and a bucket is one task, so the result does not depend on the number of
// threads.
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <optional>
#include <string>

#include "asvo/build_parts.h"

namespace asvo {
namespace {

constexpr int kBucketLevel = 3, kFineBucketLevel = 4;
/// Triangles from which on buckets are finer, so that they need not be split again; and to which,
/// since each chunk of the source has a list for each bucket.
constexpr std::uint64_t kFineFrom = 500'000, kFineTo = 32'000'000;
/// Triangles prepared at a time in a task; a bucket with more is split first.
constexpr std::size_t kMaxPrepared = 8192;

bool isFinite(const Triangle& triangle) {
  for (const glm::vec3& p : triangle.position) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) return false;
  }
  return true;
}

struct Bounds {
  glm::dvec3 lower{1e300}, upper{-1e300};
  bool empty() const { return !(lower.x <= upper.x); }
};

Bounds boundsOf(const TriangleSource& source) {
  auto extend = [&](const tbb::blocked_range<std::uint64_t>& range, Bounds bounds) {
    Triangle triangle;
    for (std::uint64_t i = range.begin(); i < range.end(); ++i) {
      source.get(i, triangle);
      if (!isFinite(triangle)) continue;
      for (const glm::vec3& p : triangle.position) {
        bounds.lower = glm::min(bounds.lower, glm::dvec3(p));
        bounds.upper = glm::max(bounds.upper, glm::dvec3(p));
      }
    }
    return bounds;
  };
  auto join = [](const Bounds& a, const Bounds& b) {
    return Bounds{glm::min(a.lower, b.lower), glm::max(a.upper, b.upper)};
  };
  return tbb::parallel_reduce(tbb::blocked_range<std::uint64_t>(0, source.count(), 4096), Bounds{},
                              extend, join);
}

/// The cube: as given, or around the bounds.
Grid makeGrid(const TriangleSource& source, const BuildOptions& options, int depth) {
  Grid grid{glm::dvec3(options.lower), options.size, depth};
  if (options.size > 0.0f) return grid;
  const Bounds bounds = boundsOf(source);
  return gridAround(bounds.lower, bounds.upper, depth);
}

/// Height over longest edge up to which a triangle counts as a line. Such a triangle has no area
/// to speak of, but its mask would stop light; its points lie within the grid's tolerance of an
/// edge that it shares with others.
constexpr double kSliver = 1e-6;

}  // namespace

bool isBuildable(const Triangle& triangle) {
  if (!isFinite(triangle)) return false;
  const glm::dvec3 a(triangle.position[0]), b(triangle.position[1]), c(triangle.position[2]);
  const glm::dvec3 ab = b - a, ac = c - a, bc = c - b, n = glm::cross(ab, ac);
  const double longest = std::max({glm::dot(ab, ab), glm::dot(ac, ac), glm::dot(bc, bc)});
  return std::sqrt(glm::dot(n, n)) > kSliver * longest;
}

Grid gridAround(const glm::dvec3& lower, const glm::dvec3& upper, int depth) {
  if (!(lower.x <= upper.x)) return {glm::dvec3(0.0), 1.0, depth};
  const glm::dvec3 size = upper - lower;
  const glm::dvec3 far = glm::max(glm::abs(lower), glm::abs(upper));
  double extent = std::max(size.x, std::max(size.y, size.z));
  extent = std::max(extent, std::max(far.x, std::max(far.y, far.z)) * 1e-5);
  if (!(extent > 0.0)) extent = 1.0;
  // Rounded to the floats that the tracer uses.
  return {glm::dvec3(glm::vec3(lower - extent * 0.0017)), static_cast<float>(extent * 1.0041),
          depth};
}

namespace {

/// A triangle that is handed down through cells. Most small ones are decided by their bounds.
class Spread {
 public:
  Spread(const Triangle& triangle, const Grid& grid) : triangle_(triangle), grid_(grid) {
    boundsOf(triangle, grid, lower_, upper_);
  }
  /// The octants of the cell at p (edge 2 * half) that it touches.
  std::uint32_t octants(const glm::vec3& p, float half) {
    const std::uint32_t possible = octantsOf(lower_, upper_, p + half);
    if (std::has_single_bit(possible)) return possible;
    if (!exact_) exact_.emplace(triangle_, grid_);
    if (!exact_->box) return possible;
    return possible & exact_->box->children(p, half, TriangleBox::kAllGroups);
  }

  /// Whether its bounds lie in one cell of a level; then its Morton code.
  bool inOneCell(int level, std::uint32_t& key) const {
    const auto cells = static_cast<float>(1u << level);
    const float inverse = cells / static_cast<float>(grid_.cells());
    const glm::vec3 low = glm::floor(lower_ * inverse);
    if (low != glm::floor(upper_ * inverse)) return false;
    if (low != glm::clamp(low, 0.0f, cells - 1.0f)) return false;
    key = mortonOf(glm::uvec3(low));
    return true;
  }

 private:
  const Triangle& triangle_;
  const Grid& grid_;
  glm::vec3 lower_, upper_;
  std::optional<GridTriangle> exact_;
};

glm::vec3 childCorner(const glm::vec3& p, float half, int octant) {
  return p + half * glm::vec3(octant & 1, octant >> 1 & 1, octant >> 2);
}

/// A triangle in the list of a cell.
struct ListEntry {
  std::uint32_t triangle;     ///< number among the prepared ones
  std::uint8_t groups;        ///< tests not decided yet
  std::uint8_t children = 0;  ///< octants it touches
};

/// Builds the leaves below one bucket.
class SubTree {
 public:
  SubTree(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves)
      : source_(source), grid_(grid), maxLeaves_(maxLeaves), leafBuilder_(source, grid) {}

  /// Splits by triangles read from the source until few enough are left to prepare them all.
  void build(int level, const glm::vec3& p, std::uint64_t key, std::vector<std::uint32_t> list) {
    if (level == grid_.depth) {
      buildLeafFromSource(p, key, list);
    } else if (list.size() <= kMaxPrepared) {
      prepare(list);
      if (!entries_.empty()) descend(level, p, key, 0, entries_.size());
    } else {
      const float half = edgeOf(level + 1);
      std::vector<std::uint32_t> lists[8];
      Triangle triangle;
      for (const std::uint32_t i : list) {
        source_.get(i, triangle);
        std::uint32_t octants = Spread(triangle, grid_).octants(p, half);
        for (; octants != 0; octants &= octants - 1) {
          lists[std::countr_zero(octants)].push_back(i);
        }
      }
      list = {};
      for (int octant = 0; octant < 8; ++octant) {
        if (lists[octant].empty()) continue;
        build(level + 1, childCorner(p, half, octant), key << 3 | octant, std::move(lists[octant]));
      }
    }
  }

  LeafList take() { return std::move(leaves_); }

 private:
  float edgeOf(int level) const { return static_cast<float>(kSubVoxels << (grid_.depth - level)); }

  void buildLeafFromSource(const glm::vec3& p, std::uint64_t key,
                           const std::vector<std::uint32_t>& list) {
    leafBuilder_.start(p);
    Triangle triangle;
    for (const std::uint32_t i : list) {
      source_.get(i, triangle);
      leafBuilder_.add(GridTriangle(triangle, grid_), TriangleBox::kAllGroups);
    }
    leafBuilder_.finish(key, leaves_);
  }

  void prepare(const std::vector<std::uint32_t>& list) {
    triangles_.clear();
    entries_.clear();
    triangles_.reserve(list.size());
    Triangle triangle;
    for (const std::uint32_t i : list) {
      source_.get(i, triangle);
      entries_.push_back({static_cast<std::uint32_t>(triangles_.size()), TriangleBox::kAllGroups});
      triangles_.emplace_back(triangle, grid_).shade = uniformShade(source_, triangle);
    }
  }

  /// The cell's list is entries_[first, last); the lists of its children are pushed behind.
  void descend(int level, const glm::vec3& p, std::uint64_t key, std::size_t first,
               std::size_t last) {
    if (level == grid_.depth) {
      leafBuilder_.start(p);
      for (std::size_t i = first; i < last; ++i) {
        leafBuilder_.add(triangles_[entries_[i].triangle], entries_[i].groups);
      }
      leafBuilder_.finish(key, leaves_);
      return;
    }
    if (leaves_.keys.size() > maxLeaves_) return;
    const float half = edgeOf(level + 1);
    std::uint32_t all = 0;
    for (std::size_t i = first; i < last; ++i) {
      ListEntry& entry = entries_[i];
      const GridTriangle& triangle = triangles_[entry.triangle];
      std::uint32_t octants = octantsOf(triangle.lower, triangle.upper, p + half);
      if (triangle.box && !std::has_single_bit(octants)) {
        const TriangleBox& box = *triangle.box;
        entry.groups = static_cast<std::uint8_t>(box.undecided(p, 2.0f * half, entry.groups));
        octants &= box.children(p, half, entry.groups);
      }
      entry.children = static_cast<std::uint8_t>(octants);
      all |= octants;
    }
    for (; all != 0; all &= all - 1) {
      const int octant = std::countr_zero(all);
      const std::size_t begin = entries_.size();
      for (std::size_t i = first; i < last; ++i) {
        const ListEntry entry = entries_[i];
        if (entry.children >> octant & 1) entries_.push_back({entry.triangle, entry.groups});
      }
      descend(level + 1, childCorner(p, half, octant), key << 3 | octant, begin, entries_.size());
      entries_.resize(begin);
    }
  }

  const TriangleSource& source_;
  const Grid& grid_;
  std::uint64_t maxLeaves_;
  LeafBuilder leafBuilder_;
  std::vector<GridTriangle> triangles_;
  std::vector<ListEntry> entries_;
  LeafList leaves_;
};

/// Triangles by bucket (Morton code at the bucket level), each list in the order of the source.
using Buckets = std::vector<std::vector<std::uint32_t>>;

/// Hands a triangle down to the buckets `levels` below the cell at p.
void spread(Spread& triangle, std::uint32_t i, int levels, const glm::vec3& p, float edge,
            std::uint32_t key, Buckets& buckets) {
  if (levels == 0) {
    buckets[key].push_back(i);
    return;
  }
  const float half = 0.5f * edge;
  std::uint32_t octants = triangle.octants(p, half);
  for (; octants != 0; octants &= octants - 1) {
    const int octant = std::countr_zero(octants);
    spread(triangle, i, levels - 1, childCorner(p, half, octant), half,
           key << 3 | static_cast<std::uint32_t>(octant), buckets);
  }
}

Buckets fillBuckets(const TriangleSource& source, const Grid& grid, int level) {
  const std::uint64_t count = source.count();
  constexpr std::uint64_t kChunk = 1u << 16;
  const std::size_t bucketCount = std::size_t{1} << (3 * level);
  std::vector<Buckets> parts((count + kChunk - 1) / kChunk);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    parts[part].resize(bucketCount);
    const std::uint64_t end = std::min(count, (part + 1) * kChunk);
    Triangle triangle;
    for (std::uint64_t i = part * kChunk; i < end; ++i) {
      source.get(i, triangle);
      if (!isBuildable(triangle)) continue;
      Spread handed(triangle, grid);
      std::uint32_t key = 0;
      if (handed.inOneCell(level, key)) {
        parts[part][key].push_back(static_cast<std::uint32_t>(i));
        continue;
      }
      spread(handed, static_cast<std::uint32_t>(i), level, glm::vec3(0.0f),
             static_cast<float>(grid.cells()), 0, parts[part]);
    }
  });
  Buckets buckets(bucketCount);
  tbb::parallel_for(std::size_t{0}, bucketCount, [&](std::size_t b) {
    std::size_t size = 0;
    for (const Buckets& part : parts) size += part[b].size();
    buckets[b].reserve(size);
    for (Buckets& part : parts) {
      buckets[b].insert(buckets[b].end(), part[b].begin(), part[b].end());
      part[b] = {};
    }
  });
  return buckets;
}

glm::vec3 cornerOfMorton(std::uint32_t key, int levels, float edge) {
  glm::vec3 p(0.0f);
  for (int l = 0; l < levels; ++l) {
    p += std::ldexp(edge, l) *
         glm::vec3(key >> (3 * l) & 1u, key >> (3 * l + 1) & 1u, key >> (3 * l + 2) & 1u);
  }
  return p;
}

/// All leaves, by bucket; false if there are more than maxLeaves.
bool buildLeaves(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves,
                 std::vector<LeafList>& lists) {
  const bool fine = source.count() >= kFineFrom && source.count() <= kFineTo;
  const int level = std::min(fine ? kFineBucketLevel : kBucketLevel, grid.depth);
  Buckets buckets = fillBuckets(source, grid, level);
  lists.assign(buckets.size(), {});
  std::atomic<std::uint64_t> total{0};
  const float edge = static_cast<float>(kSubVoxels << (grid.depth - level));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, buckets.size(), 1), [&](const auto& range) {
    for (std::size_t b = range.begin(); b < range.end(); ++b) {
      if (buckets[b].empty() || total > maxLeaves) continue;
      SubTree subTree(source, grid, maxLeaves);
      const auto key = static_cast<std::uint32_t>(b);
      subTree.build(level, cornerOfMorton(key, level, edge), key, std::move(buckets[b]));
      lists[b] = subTree.take();
      total += lists[b].keys.size();
    }
  });
  return total <= maxLeaves;
}

/// Counts the nodes of each level from the sorted keys of the leaves.
std::vector<std::uint32_t> countLevels(const std::vector<std::uint64_t>& keys, int depth) {
  std::vector<std::uint64_t> counts(static_cast<std::size_t>(depth) + 1, 0);
  for (std::size_t i = 0; i < keys.size(); ++i) {
    // A leaf starts new nodes from the first level where it differs from the leaf before.
    const int same =
        i == 0 ? -1 : depth - (static_cast<int>(std::bit_width(keys[i] ^ keys[i - 1])) + 2) / 3;
    for (int level = same + 1; level <= depth; ++level) ++counts[level];
  }
  std::vector<std::uint32_t> offsets(1, 0);
  for (const std::uint64_t count : counts) {
    offsets.push_back(offsets.back() + static_cast<std::uint32_t>(count));
  }
  return offsets;
}

template <typename T>
void append(std::vector<T>& to, std::vector<T>& from, std::size_t at) {
  std::copy(from.begin(), from.end(), to.begin() + static_cast<std::ptrdiff_t>(at));
  from = {};
}

}  // namespace

LeafList buildSubTree(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves,
                      int level, const glm::vec3& p, std::uint64_t key,
                      std::vector<std::uint32_t> list) {
  SubTree subTree(source, grid, maxLeaves);
  subTree.build(level, p, key, std::move(list));
  return subTree.take();
}

void boundsOf(const Triangle& triangle, const Grid& grid, glm::vec3& lower, glm::vec3& upper) {
  const glm::vec3* p = triangle.position;
  const glm::dvec3 low(glm::min(p[0], glm::min(p[1], p[2])));
  const glm::dvec3 high(glm::max(p[0], glm::max(p[1], p[2])));
  const double scale = grid.scale(), margin = 2.0 * grid.tolerance();
  lower = glm::vec3((low - grid.lower) * scale - margin);
  upper = glm::vec3((high - grid.lower) * scale + margin);
}

Tree assemble(std::vector<LeafList>& lists, const Grid& grid) {
  std::vector<std::size_t> starts(1, 0);
  for (const LeafList& list : lists) starts.push_back(starts.back() + list.keys.size());
  std::vector<std::uint64_t> keys(starts.back());
  for (std::size_t b = 0; b < lists.size(); ++b) append(keys, lists[b].keys, starts[b]);

  Tree tree;
  tree.levelOffsets = countLevels(keys, grid.depth);
  const std::uint32_t nodeCount = tree.levelOffsets.back();
  const std::uint32_t firstLeaf = tree.levelOffsets[grid.depth];
  tree.info = {static_cast<float>(grid.lower.x),
               static_cast<float>(grid.lower.y),
               static_cast<float>(grid.lower.z),
               static_cast<float>(grid.size),
               static_cast<uint>(grid.depth),
               nodeCount,
               firstLeaf,
               nodeCount - firstLeaf};
  tree.nodes.assign(nodeCount, uvec2(0u));
  tree.voxels.resize(nodeCount);
  tree.leaves.resize(tree.info.leafCount);
  std::vector<Surface> surfaces(nodeCount);
  tbb::parallel_for(std::size_t{0}, lists.size(), [&](std::size_t b) {
    append(tree.voxels, lists[b].voxels, firstLeaf + starts[b]);
    append(tree.leaves, lists[b].leaves, starts[b]);
    append(surfaces, lists[b].surfaces, firstLeaf + starts[b]);
  });
  std::vector<EmittedPower> emitters;
  for (std::size_t b = 0; b < lists.size(); ++b) {
    for (EmittedPower power : lists[b].emitters) {
      power.node += firstLeaf + static_cast<std::uint32_t>(starts[b]);
      emitters.push_back(power);
    }
  }
  buildLevels(tree, std::move(keys), surfaces, std::move(emitters));
  return tree;
}

Tree emptyTree(const Grid& grid) {
  Tree tree;
  tree.info = {static_cast<float>(grid.lower.x),
               static_cast<float>(grid.lower.y),
               static_cast<float>(grid.lower.z),
               static_cast<float>(grid.size),
               1u,
               1u,
               1u,
               0u};
  tree.nodes.assign(1, uvec2(1u, 0u));
  tree.voxels.assign(1, VoxelSums().pack(0.5f));
  tree.levelOffsets = {0, 1, 1};
  return tree;
}

std::uint64_t bytesOf(const Tree& tree) {
  return tree.nodes.size() * kBytesPerNode + tree.leaves.size() * sizeof(uvec2) +
         tree.emitters.size() * sizeof(Emitter);
}

namespace {

void check(const TriangleSource& source, const BuildOptions& options) {
  if (options.depth < 0 || options.depth > static_cast<int>(ASVO_MAX_DEPTH)) {
    throw std::invalid_argument("asvo: depth must lie in 0.." + std::to_string(ASVO_MAX_DEPTH));
  }
  if (source.count() > 0xffffffffull) {
    throw std::invalid_argument("asvo: more than 2^32 - 1 triangles");
  }
  const glm::vec3 lower = options.lower;
  if (!std::isfinite(options.size) || options.size < 0.0f || !std::isfinite(lower.x) ||
      !std::isfinite(lower.y) || !std::isfinite(lower.z)) {
    throw std::invalid_argument("asvo: the cube must be finite and its size not negative");
  }
}

}  // namespace

glm::vec3 Tree::emission(std::uint32_t node, bool front) const {
  const auto at = std::lower_bound(emitters.begin(), emitters.end(), node,
                                   [](const Emitter& e, std::uint32_t n) { return e.node < n; });
  if (at == emitters.end() || at->node != node) return glm::vec3(0.0f);
  return packer().asvoUnpackRgb9e5(front ? at->front : at->back);
}

float Tree::leafArea(std::uint32_t node) const {
  return Tracer(*this).asvoArea(node) * edge(info.depth) * edge(info.depth);
}

GridTriangle::GridTriangle(const Triangle& triangle, const Grid& grid)
    : source(triangle),
      vertex{(glm::dvec3(triangle.position[0]) - grid.lower) * grid.scale(),
             (glm::dvec3(triangle.position[1]) - grid.lower) * grid.scale(),
             (glm::dvec3(triangle.position[2]) - grid.lower) * grid.scale()},
      normal(glm::cross(vertex[1] - vertex[0], vertex[2] - vertex[0])),
      flatAxis(-1) {
  boundsOf(triangle, grid, lower, upper);
  const double length = glm::length(normal);
  normal = length > 0.0 ? normal / length : glm::dvec3(0.0, 0.0, 1.0);
  const glm::bvec3 crosses = glm::notEqual(glm::floor(lower), glm::floor(upper));
  if (crosses.x + crosses.y + crosses.z > 1) box.emplace(vertex, normal, grid.tolerance());
  for (int axis = 0; axis < 3; ++axis) {
    const double a = vertex[0][axis], b = vertex[1][axis], c = vertex[2][axis];
    const double thickness = std::max(a, std::max(b, c)) - std::min(a, std::min(b, c));
    if (thickness <= grid.tolerance() && std::abs(normal[axis]) > 0.9) flatAxis = axis;
  }
}

int levelsToDeepen(std::uint64_t leaves, int depth) {
  constexpr double kNearlyEmpty = 16.0;  // so that rooms and halls of any shape stay as they are
  const double full = 6.0 * std::ldexp(1.0, 2 * depth);
  const double times = full / std::max(1.0, static_cast<double>(leaves));
  if (times < kNearlyEmpty) return 0;
  return std::min(std::ilogb(times) / 2, static_cast<int>(ASVO_MAX_DEPTH) - depth);
}

Tree Tree::build(const TriangleSource& source, const BuildOptions& options) {
  check(source, options);
  constexpr std::uint64_t kMaxLeaves = 1ull << 28;  // node numbers of 32 bits, twice
  std::uint64_t maxLeaves = std::min(options.maxLeaves, kMaxLeaves);
  if (options.maxBytes > 0) maxLeaves = std::min(maxLeaves, options.maxBytes / kBytesPerLeaf);
  const int wanted = options.depth > 0 ? options.depth : 8;
  Grid grid = makeGrid(source, options, wanted);
  grid.depth = possibleDepth(source, grid, maxLeaves, options.maxBytes);
  bool deepen = options.deepen;
  for (;; --grid.depth) {
    const bool last = grid.depth == 1;
    std::vector<LeafList> lists;
    if (!buildLeaves(source, grid, last ? kMaxLeaves : maxLeaves, lists)) continue;
    bool any = false;
    for (const LeafList& list : lists) any = any || !list.keys.empty();
    if (!any) return emptyTree(grid);
    Tree tree = assemble(lists, grid);
    if (!last && options.maxBytes > 0 && bytesOf(tree) > options.maxBytes) continue;
    const bool whole = deepen && grid.depth == wanted;
    const int more = whole ? levelsToDeepen(tree.leaves.size(), wanted) : 0;
    if (more == 0) return tree;
    deepen = false;
    grid.depth += more + 1;
  }
}

}  // namespace asvo
