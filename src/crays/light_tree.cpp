#include "src/crays/light_tree.h"

#include <algorithm>
#include <cmath>

#include "src/core/prefetch.h"

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
    std::uint32_t lane = 0;
    for (std::uint32_t i = 0; i + 1 < kLanes; ++i) lane += target >= upTo[i] ? 1u : 0u;
    // Of a target that was rounded up to the sum of all.
    while (lane > 0 && !(weights[lane] > 0.0f)) --lane;
    return lane;
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

bool LightTree::choose(const Cut& cut, double u, Choice& out) const {
  Question question{&cut, u, {}};
  choose({&question, 1});
  out = question.choice;
  return out.chance > 0.0f;
}

void LightTree::choose(std::span<Question> questions) const {
  constexpr std::size_t kTogether = 16;
  for (; questions.size() > kTogether; questions = questions.subspan(kTogether))
    choose(questions.first(kTogether));
  Place at[kTogether];
  std::uint8_t under[kTogether];
  std::size_t count = 0;
  for (std::size_t i = 0; i < questions.size(); ++i)
    if (begin(questions[i], at[i])) under[count++] = static_cast<std::uint8_t>(i);
  while (count != 0) {
    std::size_t left = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const std::uint8_t i = under[k];
      if (goDown(questions[i], at[i])) {
        under[left++] = i;
      } else {
        end(questions[i], at[i]);
      }
    }
    count = left;
  }
}

/// The node of the cut. False if there is none.
bool LightTree::begin(Question& q, Place& at) const {
  const Cut& cut = *q.cut;
  q.choice = Choice();
  if (cut.count == 0) return false;
  double target = q.u * static_cast<double>(cut.sum);
  int which = 0;
  while (which + 1 < cut.count && target >= static_cast<double>(cut.weights[which])) {
    target -= static_cast<double>(cut.weights[which++]);
  }
  q.choice.chance = cut.weights[which] / cut.sum;
  q.u = std::min(target / static_cast<double>(cut.weights[which]), 0x1.fffffffffffffp-1);
  at = {&nodes_[cut.nodes[which] / kLanes], cut.nodes[which] % kLanes};
  return true;
}

/// To one of a node's children. False at a leaf, or at a node without any weight.
bool LightTree::goDown(Question& q, Place& at) const {
  if (at.node->child[at.lane] == 0) return false;
  at.node = &nodes_[at.node->child[at.lane]];
  Sums sums;
  weigh_(*at.node, q.cut->position, q.cut->normal, sums.weights);
  sums.add();
  if (!(sums.all() > 0.0)) {
    q.choice.chance = 0.0f;
    return false;
  }
  const double share = q.u * sums.all();
  at.lane = sums.find(share);
  q.u = std::min(sums.rest(at.lane, share) / sums.weight(at.lane), 0x1.fffffffffffffp-1);
  q.choice.chance *= static_cast<float>(sums.weight(at.lane) / sums.all());
  if (at.node->child[at.lane] != 0) prefetch(&nodes_[at.node->child[at.lane]], sizeof(LightNodes));
  return true;
}

void LightTree::end(Question& q, const Place& leaf) const {
  q.choice.first = leaf.node->first[leaf.lane];
  q.choice.count = leaf.node->count[leaf.lane];
  q.choice.rest = q.u;
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
  Place at{&nodes_[cut.nodes[which] / kLanes], cut.nodes[which] % kLanes};
  while (at.node->child[at.lane] != 0) {
    at = {&nodes_[at.node->child[at.lane]], 0};
    Sums sums;
    weigh_(*at.node, cut.position, cut.normal, sums.weights);
    sums.add();
    if (!(sums.all() > 0.0)) return 0.0f;
    while (!holds(*at.node, at.lane)) ++at.lane;
    chance *= static_cast<float>(sums.weight(at.lane) / sums.all());
  }
  return chance * shares_[place];
}

std::uint64_t LightTree::bytes() const {
  return nodes_.size() * sizeof(LightNodes) +
         order_.size() * (2 * sizeof(std::uint32_t) + sizeof(float));
}

}  // namespace trex
