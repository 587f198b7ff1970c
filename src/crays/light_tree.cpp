#include "src/crays/light_tree.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

/// A node is opened where the point is closer to its centre than this many radii.
constexpr float kClose = 1.5f;
/// Nodes that are weighed at least, if there are as many.
constexpr int kLeastCut = 8;
/// Of a light that a surface sees from behind, as bounds have it: shading normals, rounding.
constexpr float kLeastCosine = 0.02f;
constexpr float kLeastDistance2 = 1e-12f;

}  // namespace

/// About the irradiance at a point; 0 only where no light of the node shines.
float LightTree::weigh(const Node& node, const vec3& position, const vec3& normal) {
  const vec3 away = position - node.centre;
  const float distance2 = std::max(glm::dot(away, away), kLeastDistance2);
  // Within its own size a light may be anywhere around.
  const float radius2 = node.radius * node.radius;
  if (distance2 <= radius2) return node.power / std::max(distance2, 0.25f * radius2);
  const float inverse = 1.0f / std::sqrt(distance2);
  const float sinSize = node.radius * inverse;  // of the node's half angle
  const float cosSize = std::sqrt(std::max(0.0f, 1.0f - sinSize * sinSize));
  float cosine = glm::dot(node.axis, away) * inverse;
  if (node.bothSides) cosine = std::abs(cosine);
  float facing = 1.0f;
  if (cosine < node.cosSpread) {
    const float sine = std::sqrt(std::max(0.0f, 1.0f - cosine * cosine));
    const float cosBeyond = cosine * node.cosSpread + sine * node.sinSpread;
    const float sinBeyond = sine * node.cosSpread - cosine * node.sinSpread;
    if (cosBeyond < cosSize) facing = cosBeyond * cosSize + sinBeyond * sinSize;
    if (facing < node.cosReach - 1e-3f) return 0.0f;
    facing = std::max(facing, 1e-3f);
  }
  const float cosIn = -glm::dot(normal, away) * inverse;  // 0 without a normal
  float arriving = 1.0f;
  if (cosIn < cosSize && normal != vec3(0.0f)) {
    arriving = cosIn * cosSize + std::sqrt(std::max(0.0f, 1.0f - cosIn * cosIn)) * sinSize;
    arriving = std::max(arriving, kLeastCosine);
  }
  return node.power * facing * arriving * inverse * inverse;
}

void LightTree::cut(const vec3& position, const vec3& normal, Cut& out) const {
  out.position = position;
  out.normal = normal;
  out.count = 0;
  out.sum = 0.0f;
  std::uint32_t queue[2 * kMostCut];
  queue[0] = 0;
  int head = 0, tail = nodes_.empty() ? 0 : 1;
  while (head < tail) {
    const std::uint32_t index = queue[head++];
    const Node& node = nodes_[index];
    const int weighed = out.count + tail - head + 1;  // if no more are opened
    if (!isLeaf(node) && weighed < kMostCut && tail + 2 <= 2 * kMostCut) {
      const vec3 away = position - node.centre;
      if (weighed < kLeastCut ||
          glm::dot(away, away) < kClose * kClose * node.radius * node.radius) {
        __builtin_prefetch(&nodes_[node.right]);
        queue[tail++] = index + 1;
        queue[tail++] = node.right;
        continue;
      }
    }
    const float weight = weigh(node, position, normal);
    if (!(weight > 0.0f)) continue;
    out.nodes[out.count] = index;
    out.weights[out.count++] = weight;
    out.sum += weight;
  }
}

void LightTree::cutAlone(Cut& out) const {
  out.count = 1;
  out.nodes[0] = 0;
  out.weights[0] = out.sum = 1.0f;
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
  std::uint32_t index = cut.nodes[which];
  while (!isLeaf(nodes_[index])) {
    __builtin_prefetch(&nodes_[nodes_[index].right]);
    const float left = weigh(nodes_[index + 1], cut.position, cut.normal);
    const float right = weigh(nodes_[nodes_[index].right], cut.position, cut.normal);
    if (!(left + right > 0.0f)) return false;
    const float toLeft = left / (left + right);
    if (u < static_cast<double>(toLeft)) {
      out.chance *= toLeft;
      u /= static_cast<double>(toLeft);
      index = index + 1;
    } else {
      out.chance *= 1.0f - toLeft;
      u = (u - static_cast<double>(toLeft)) / (1.0 - static_cast<double>(toLeft));
      index = nodes_[index].right;
    }
    u = std::min(u, 0x1.fffffffffffffp-1);
  }
  out.first = nodes_[index].first;
  out.count = nodes_[index].count;
  out.rest = u;
  return out.chance > 0.0f;
}

float LightTree::chance(const Cut& cut, std::uint32_t light) const {
  const std::uint32_t place = place_[light];
  int which = 0;
  while (which < cut.count &&
         place - nodes_[cut.nodes[which]].first >= nodes_[cut.nodes[which]].count) {
    ++which;
  }
  if (which == cut.count) return 0.0f;
  float chance = cut.weights[which] / cut.sum;
  std::uint32_t index = cut.nodes[which];
  while (!isLeaf(nodes_[index])) {
    const std::uint32_t other = nodes_[index].right;
    const float left = weigh(nodes_[index + 1], cut.position, cut.normal);
    const float right = weigh(nodes_[other], cut.position, cut.normal);
    if (!(left + right > 0.0f)) return 0.0f;
    const float toLeft = left / (left + right);
    const bool isRight = place >= nodes_[other].first;
    chance *= isRight ? 1.0f - toLeft : toLeft;
    index = isRight ? other : index + 1;
  }
  return chance * shares_[place];
}

std::uint64_t LightTree::bytes() const {
  return nodes_.size() * sizeof(Node) + order_.size() * (2 * sizeof(std::uint32_t) + sizeof(float));
}

}  // namespace trex
