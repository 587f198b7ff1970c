// Many lights, one chosen at a point in proportion to about the irradiance that it gives there: a
// bounding volume hierarchy of lights whose nodes know power, place and directions [Conty Estevez
// and Kulla, Importance Sampling of Many Lights with Adaptive Tree Splitting, 2018].
//
// Nodes have up to eight children, which are weighed at once. A choice first weighs those of the
// root and opens the ones that the point is close to, which nothing can be said of as a whole; what
// is then left is a "cut" of at most kMostCut nodes. From the chosen one it goes down to a leaf:
// the cost grows with the logarithm of the number of lights.
//
// Immutable after building, so thread safe. Built with oneTBB; the same for any number of threads.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/light_tree_weigh.h"

namespace trex {

/// A light as the tree sees it: sends `power` times the cosine of what it exceeds the cone of
/// half angle `spread` around `axis` by, up to `reach` beyond the cone.
struct LightBounds {
  static constexpr std::uint32_t kAlone = 0xffffffffu;
  Box3f box;
  vec3 axis{0.0f, 0.0f, 1.0f};
  float spread = 0.0f;  ///< radians, [0, pi]
  float reach = 0.0f;   ///< radians, [0, pi]
  float power = 0.0f;   ///< radiant intensity at most, above 0
  bool bothSides = false;
  /// Up to four neighbours of one group that face the same way may share a leaf, where they are
  /// chosen by power alone.
  std::uint32_t group = kAlone;
};

class LightTree {
 public:
  static constexpr std::uint32_t kNoLight = 0xffffffffu;
  static constexpr int kMostCut = 64;

  LightTree() = default;
  /// Numbers of lights are those of the span. Boxes should fit the unit sphere and powers (0, 1],
  /// about: single precision overflows far from there.
  explicit LightTree(std::span<const LightBounds> lights);

  bool empty() const { return nodes_.empty(); }
  std::uint64_t bytes() const;

  /// The nodes that are weighed at a point, and their weights.
  struct Cut {
    vec3 position, normal;
    int count = 0;
    std::uint32_t nodes[kMostCut];  ///< LightNodes::kLanes * index + lane
    float weights[kMostCut];
    float sum = 0.0f;  ///< about the irradiance of all lights, by luminance; 0 if none shines there
  };
  /// `position` in the space of the lights' boxes.
  void cut(const vec3& position, const vec3& normal, Cut& out) const;
  /// Whether all lights share a leaf; cutAlone() is the cut then wherever nothing else is weighed.
  bool single() const {
    return !nodes_.empty() && nodes_.front().children == 1 && nodes_.front().child[0] == 0;
  }
  void cutAlone(Cut& out) const;

  /// A light of a leaf, chosen by `u` in [0, 1): its leaf's chance, and u made uniform again.
  struct Choice {
    std::uint32_t first = 0, count = 0;  ///< places of the leaf's lights, see light()
    float chance = 0.0f;
    double rest = 0.0;
  };
  /// False if no light can be chosen.
  bool choose(const Cut& cut, double u, Choice& out) const;
  /// The same for several points, with the same bits: they go down level by level, so that one
  /// waits for its nodes while others are weighed. Where no light can be chosen the chance is 0.
  struct Question {
    const Cut* cut;
    double u;
    Choice choice;
  };
  void choose(std::span<Question> questions) const;
  /// The light at a place of the order of leaves, and its share of its leaf.
  std::uint32_t light(std::uint32_t place) const { return order_[place]; }
  float share(std::uint32_t place) const { return shares_[place]; }
  /// Chance with which a light of this number is chosen, its share of the leaf included.
  float chance(const Cut& cut, std::uint32_t light) const;

 private:
  struct Builder;
  struct Place {
    const LightNodes* node;
    std::uint32_t lane;
  };

  bool begin(Question& question, Place& at) const;
  bool goDown(Question& question, Place& at) const;
  void end(Question& question, const Place& leaf) const;

  WeighLights weigh_ = chooseWeighLights();
  std::vector<LightNodes> nodes_;
  std::vector<std::uint32_t> order_;  ///< numbers of lights in the order of leaves
  std::vector<std::uint32_t> place_;  ///< inverse of order_
  std::vector<float> shares_;         ///< of its leaf's power, by place
};

}  // namespace trex
