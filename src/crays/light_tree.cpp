#include "src/crays/light_tree.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr std::uint32_t kLanes = LightNodes::kLanes;
/// Nodes whose children are weighed for a cut.
constexpr int kMostOpened = LightTree::kMostCut / static_cast<int>(kLanes);

/// Sums of the weights up to each lane, exact but for the last bits of double precision.
struct Sums {
  alignas(32) float weights[kLanes];
  double upTo[kLanes];
  void add() {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < kLanes; ++i) upTo[i] = sum += static_cast<double>(weights[i]);
  }
  double all() const { return upTo[kLanes - 1]; }
  double weight(std::uint32_t lane) const { return static_cast<double>(weights[lane]); }
  /// What is left of a share of all when the lanes before are taken away.
  double rest(std::uint32_t lane, double share) const {
    return lane > 0 ? share - upTo[lane - 1] : share;
  }
  /// The lane that holds a share of all; never one without weight.
  std::uint32_t find(double target) const {
    std::uint32_t lane = 0, last = 0;
    for (std::uint32_t i = 0; i + 1 < kLanes; ++i) {
      lane += target >= upTo[i] ? 1u : 0u;
      last += upTo[i] < all() ? 1u : 0u;
    }
    return std::min(lane, last);
  }
};

}  // namespace

void LightTree::cut(const vec3& position, const vec3& normal, Cut& out) const {
  out.position = position;
  out.normal = normal;
  out.count = 0;
  out.sum = 0.0f;
  std::uint32_t opened[kMostOpened] = {0};
  int known = nodes_.empty() ? 0 : 1;
  for (int i = 0; i < known; ++i) {
    const LightNodes& node = nodes_[opened[i]];
    alignas(32) float weights[kLanes];
    const std::uint32_t close = weigh_(node, position, normal, weights);
    for (std::uint32_t lane = 0; lane < node.children; ++lane) {
      if (!(weights[lane] > 0.0f)) continue;
      if ((close >> lane & 1u) != 0 && node.child[lane] != 0 && known < kMostOpened) {
        opened[known++] = node.child[lane];
        continue;
      }
      out.nodes[out.count] = kLanes * opened[i] + lane;
      out.weights[out.count++] = weights[lane];
      out.sum += weights[lane];
    }
  }
}

void LightTree::cutAlone(Cut& out) const {
  out.count = 1;
  out.nodes[0] = 0;
  out.weights[0] = out.sum = 1.0f;
}

/// From a node of the cut to a leaf by the lanes that `pick` names, whose chances are multiplied to
/// `chance`; 0 if a node on the way has no weight at all.
template <typename Pick>
LightTree::Place LightTree::descend(const Cut& cut, std::uint32_t from, const Pick& pick,
                                    float& chance) const {
  Place at{&nodes_[from / kLanes], from % kLanes};
  while (at.node->child[at.lane] != 0) {
    at.node = &nodes_[at.node->child[at.lane]];
    Sums sums;
    weigh_(*at.node, cut.position, cut.normal, sums.weights);
    sums.add();
    if (!(sums.all() > 0.0)) {
      chance = 0.0f;
      break;
    }
    at.lane = pick(*at.node, sums);
    chance *= static_cast<float>(sums.weight(at.lane) / sums.all());
  }
  return at;
}

bool LightTree::choose(const Cut& cut, double u, Choice& out) const {
  if (cut.count == 0) return false;
  double target = u * static_cast<double>(cut.sum);
  int which = 0;
  while (which + 1 < cut.count && target >= static_cast<double>(cut.weights[which])) {
    target -= static_cast<double>(cut.weights[which++]);
  }
  out.chance = cut.weights[which] / cut.sum;
  u = std::min(target / static_cast<double>(cut.weights[which]), 0x1.fffffffffffffp-1);
  const auto pick = [&](const LightNodes&, const Sums& sums) {
    const double share = u * sums.all();
    const std::uint32_t lane = sums.find(share);
    u = std::min(sums.rest(lane, share) / sums.weight(lane), 0x1.fffffffffffffp-1);
    return lane;
  };
  const Place leaf = descend(cut, cut.nodes[which], pick, out.chance);
  out.first = leaf.node->first[leaf.lane];
  out.count = leaf.node->count[leaf.lane];
  out.rest = u;
  return out.chance > 0.0f;
}

float LightTree::chance(const Cut& cut, std::uint32_t light) const {
  const std::uint32_t place = place_[light];
  const auto holds = [&](const LightNodes& node, std::uint32_t lane) {
    return place - node.first[lane] < node.count[lane];
  };
  int which = 0;
  while (which < cut.count &&
         !holds(nodes_[cut.nodes[which] / kLanes], cut.nodes[which] % kLanes)) {
    ++which;
  }
  if (which == cut.count) return 0.0f;
  float chance = cut.weights[which] / cut.sum;
  const auto pick = [&](const LightNodes& node, const Sums&) {
    std::uint32_t lane = 0;
    while (!holds(node, lane)) ++lane;
    return lane;
  };
  descend(cut, cut.nodes[which], pick, chance);
  return chance * shares_[place];
}

std::uint64_t LightTree::bytes() const {
  return nodes_.size() * sizeof(LightNodes) +
         order_.size() * (2 * sizeof(std::uint32_t) + sizeof(float));
}

}  // namespace trex
