#include "src/grays/resolve.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>

#include "asvo/tracer.h"

namespace trex {

namespace {

using glm::vec3;

/// Faces of less than this share of a side are what edges of others leave there.
constexpr float kFewFaces = 0.25f;

/// Sums over a sub-tree, by side (0 front).
struct Sums {
  vec3 total[2] = {vec3(0.0f), vec3(0.0f)};
  float all = 0.0f;                 ///< area of all faces
  float faces[2] = {0.0f, 0.0f};    ///< area of the faces of that side
  float sheets[2] = {0.0f, 0.0f};   ///< of those that have the other side alone
  bool behind[2] = {false, false};  ///< light came to the backs of such

  /// What the light fell on. The back of a face is the inside of a solid, and counts only once
  /// light was seen there: counted always, it would darken walls that lie within one voxel with
  /// their outer faces.
  float area(int side) const { return faces[side] + (behind[side] ? sheets[side] : 0.0f); }

  void add(const Sums& child, bool flipped) {
    all += child.all;
    for (int side = 0; side < 2; ++side) {
      const int from = flipped ? 1 - side : side;
      total[side] += child.total[from];
      faces[side] += child.faces[from];
      sheets[side] += child.sheets[from];
      behind[side] |= child.behind[from];
    }
  }
};

/// Area of the faces against a leaf's normal over that of those along it, by their coverages: 0
/// for a few.
float backShare(const asvo::Tree& tree, const asvo::Tracer& tracer, std::uint32_t node) {
  const vec3 n = tracer.asvoNormal(node);
  float along = 0.0f, against = 0.0f;
  for (int axis = 0; axis < 3; ++axis) {
    const auto facing = static_cast<std::uint32_t>(2 * axis) + (n[axis] < 0.0f ? 1u : 0u);
    const float part = std::abs(n[axis]);
    along += part * static_cast<float>(tracer.asvoCoverage(tree.voxels[node], facing));
    against += part * static_cast<float>(tracer.asvoCoverage(tree.voxels[node], facing ^ 1u));
  }
  const float share = along > 0.0f ? std::min(against / along, 1.0f) : 1.0f;
  return share < kFewFaces ? 0.0f : share;
}

template <typename Function>
void forChildren(const asvo::Tree& tree, std::uint32_t node, const Function& function) {
  const asvo::uvec2 links = tree.nodes[node];
  const auto count = static_cast<std::uint32_t>(std::popcount(links.y & 255u));
  for (std::uint32_t i = 0; i < count; ++i) function(links.x + i);
}

}  // namespace

TreeFaces::TreeFaces(const asvo::Tree& tree)
    : leaves(tree.info.leafCount), flips(tree.info.nodeCount, 0) {
  const asvo::Tracer tracer(tree);
  const std::uint32_t first = tree.info.firstLeaf;
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, tree.info.nodeCount, 1024),
                    [&](const tbb::blocked_range<std::uint32_t>& range) {
                      for (std::uint32_t node = range.begin(); node != range.end(); ++node) {
                        if (node >= first) {
                          const float area = tree.leafArea(node);
                          leaves[node - first] = {area, area * backShare(tree, tracer, node)};
                          continue;
                        }
                        forChildren(tree, node, [&](std::uint32_t child) {
                          flips[child] = tracer.asvoFlips(child, node);
                        });
                      }
                    });
}

struct LightResolver::Work {
 public:
  Work(const asvo::Tree& tree, const TreeFaces& faces, std::span<const std::uint32_t> direct,
       std::span<const std::uint32_t> indirect, double wattsPerCount, std::span<asvo::uvec4> light)
      : tree_(tree),
        faces_(faces),
        tracer_(tree),
        direct_(direct),
        indirect_(indirect),
        wattsPerCount_(wattsPerCount),
        light_(light),
        inner_(tree.info.firstLeaf) {
    const float edge = tree.info.size / static_cast<float>(1u << tree.info.depth);
    leastArea_ = kLeastArea * edge * edge;
  }

  /// Steps up the levels, then down again.
  bool advance(const std::function<bool()>& keepGoing) {
    const int depth = static_cast<int>(tree_.info.depth);
    for (; step_ < 2 * depth; ++step_, next_ = 0) {
      const bool up = step_ < depth;
      const int level = up ? depth - 1 - step_ : step_ - depth;
      if (step_ == depth && next_ == 0 && tree_.info.nodeCount > 0) {
        light_[0] = pack(irradiance(sums(0), asvo::uvec4(0u)));
      }
      const auto each = [&](std::uint32_t node) { up ? sumChildren(node) : lightChildren(node); };
      if (!forLevel(level, keepGoing, each)) return false;
    }
    return true;
  }

 private:
  struct Irradiance {
    vec3 faces[2], voxel[2];
  };

  template <typename Function>
  bool forLevel(int level, const std::function<bool()>& keepGoing, const Function& function) {
    constexpr std::uint32_t kPiece = 1u << 14;
    const auto l = static_cast<std::size_t>(level);
    const std::uint32_t first = tree_.levelOffsets[l], end = tree_.levelOffsets[l + 1];
    for (; first + next_ < end; next_ += kPiece) {
      if (next_ > 0 && !keepGoing()) return false;
      tbb::parallel_for(tbb::blocked_range<std::uint32_t>(
                            first + next_, std::min(first + next_ + kPiece, end), 256),
                        [&](const tbb::blocked_range<std::uint32_t>& range) {
                          for (std::uint32_t node = range.begin(); node != range.end(); ++node)
                            function(node);
                        });
    }
    return true;
  }

  vec3 flux(std::span<const std::uint32_t> words, std::uint32_t leaf, int side) const {
    vec3 sum;
    for (int channel = 0; channel < 3; ++channel) {
      const std::size_t at =
          leaf * kWordsPerLeaf + static_cast<std::size_t>(side * 6 + channel * 2);
      const std::uint64_t counts = words[at] | std::uint64_t{words[at + 1]} << 32;
      sum[channel] = static_cast<float>(static_cast<double>(counts) * wattsPerCount_);
    }
    return sum;
  }

  Sums sums(std::uint32_t node) const {
    if (node < tree_.info.firstLeaf) return inner_[node];
    Sums s;
    const std::uint32_t leaf = node - tree_.info.firstLeaf;
    for (int side = 0; side < 2; ++side) {
      s.total[side] = flux(direct_, leaf, side) + flux(indirect_, leaf, side);
    }
    const auto [area, back] = faces_.leaves[leaf];
    s.faces[0] = s.all = area;
    (back > 0.0f ? s.faces[1] : s.sheets[1]) = back > 0.0f ? back : area;
    s.behind[1] = back <= 0.0f && s.total[1] != vec3(0.0f);
    return s;
  }

  void sumChildren(std::uint32_t node) {
    Sums s;
    forChildren(tree_, node,
                [&](std::uint32_t child) { s.add(sums(child), faces_.flips[child] != 0); });
    inner_[node] = s;
  }

  void lightChildren(std::uint32_t node) {
    const asvo::uvec4 own = light_[node];
    forChildren(tree_, node, [&](std::uint32_t child) {
      const bool flips = faces_.flips[child] != 0;
      const asvo::uvec4 coarser = flips ? asvo::uvec4(own.y, own.x, own.w, own.z) : own;
      light_[child] = pack(irradiance(sums(child), coarser));
    });
  }

  /// Quotients of a voxel; `coarser` is its parent's light, sides already matched.
  Irradiance irradiance(const Sums& s, const asvo::uvec4& coarser) const {
    Irradiance e;
    for (int side = 0; side < 2; ++side) {
      const float area = s.area(side);
      if (area >= leastArea_) {
        e.faces[side] = s.total[side] / area;
      } else if (!s.behind[side] && s.sheets[side] >= leastArea_) {
        e.faces[side] = vec3(0.0f);
      } else {
        e.faces[side] = tracer_.asvoUnpackRgb9e5(side == 0 ? coarser.x : coarser.y);
      }
      e.voxel[side] = s.all >= leastArea_
                          ? s.total[side] / s.all
                          : tracer_.asvoUnpackRgb9e5(side == 0 ? coarser.z : coarser.w);
    }
    return e;
  }

  asvo::uvec4 pack(const Irradiance& e) const {
    return asvo::uvec4(tracer_.asvoPackRgb9e5(e.faces[0]), tracer_.asvoPackRgb9e5(e.faces[1]),
                       tracer_.asvoPackRgb9e5(e.voxel[0]), tracer_.asvoPackRgb9e5(e.voxel[1]));
  }

  const asvo::Tree& tree_;
  const TreeFaces& faces_;
  const asvo::Tracer tracer_;
  std::span<const std::uint32_t> direct_, indirect_;
  double wattsPerCount_;
  std::span<asvo::uvec4> light_;
  std::vector<Sums> inner_;
  float leastArea_ = 0.0f;
  int step_ = 0;
  std::uint32_t next_ = 0;  ///< of the level under way
};

LightResolver::LightResolver(const asvo::Tree& tree, const TreeFaces& faces,
                             std::span<const std::uint32_t> direct,
                             std::span<const std::uint32_t> indirect, double wattsPerCount,
                             std::span<asvo::uvec4> light) {
  assert(direct.size() >= tree.info.leafCount * kWordsPerLeaf && light.size() == tree.nodes.size());
  assert(indirect.size() == direct.size());
  work_ = std::make_unique<Work>(tree, faces, direct, indirect, wattsPerCount, light);
}

LightResolver::~LightResolver() = default;

bool LightResolver::advance(const std::function<bool()>& keepGoing) {
  return work_->advance(keepGoing);
}

bool LightBuffers::resolve(const asvo::Tree& tree, std::span<const std::uint32_t> direct,
                           std::span<const std::uint32_t> indirect, double wattsPerCount,
                           std::uint64_t photons, const std::function<bool()>& keepGoing) {
  if (photons != photons_) restart();
  photons_ = photons;
  if (!resolver_) {
    prepare(tree);
    resolver_ = std::make_unique<LightResolver>(tree, *faces_, direct, indirect, wattsPerCount,
                                                std::span(back_));
  }
  if (!resolver_->advance(keepGoing)) return false;
  resolver_.reset();
  front_.swap(back_);
  return true;
}

}  // namespace trex
