// Building a light tree: from the root down in halves, by the surface area orientation heuristic of
// Conty Estevez and Kulla on bins; then nodes of eight take the place of those of two.
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "src/crays/light_tree.h"

namespace trex {
namespace {

constexpr std::uint32_t kMostBins = 12;
constexpr std::uint32_t kMostInLeaf = 4;
constexpr std::uint32_t kSmallTask = 4096;  // lights; more are worth two threads

/// Directions that a node's lights shine in: a cone, and how far beyond it.
struct Directions {
  vec3 axis{0.0f, 0.0f, 1.0f};
  float spread = -1.0f;  ///< radians; below 0: none yet
  float reach = 0.0f;
  bool bothSides = false;
};

Directions directionsOf(const LightBounds& light) {
  return {light.axis, light.spread, light.reach, light.bothSides};
}

/// The axis turned by an angle towards another one.
vec3 turned(const vec3& axis, const vec3& towards, float angle) {
  const vec3 across = towards - glm::dot(axis, towards) * axis;
  const float length = glm::length(across);
  if (!(length > 1e-6f)) return axis;
  return glm::normalize(std::cos(angle) * axis + std::sin(angle) / length * across);
}

Directions joined(Directions a, Directions b) {
  if (a.spread < 0.0f) return b;
  if (b.spread < 0.0f) return a;
  Directions out;
  out.bothSides = a.bothSides && b.bothSides;
  out.reach = std::max(a.reach, b.reach);
  out.axis = a.axis;
  out.spread = kPi;
  if (a.bothSides != b.bothSides) return out;
  if (out.bothSides && glm::dot(a.axis, b.axis) < 0.0f) b.axis = -b.axis;
  if (a.spread < b.spread) std::swap(a, b);
  const float between = std::acos(std::clamp(glm::dot(a.axis, b.axis), -1.0f, 1.0f));
  out.axis = a.axis;
  if (std::min(between + b.spread, kPi) <= a.spread) {
    out.spread = a.spread;
    return out;
  }
  const float spread = 0.5f * (a.spread + between + b.spread);
  if (spread >= kPi) return out;
  out.axis = turned(a.axis, b.axis, spread - a.spread);
  out.spread = std::min(spread + 1e-3f, kPi);  // rounding of the axis
  return out;
}

/// What the heuristic knows of some lights. The directions are told by the length of the mean axis:
/// of axes spread evenly over a cone it is (1 + cos) / 2.
struct Sum {
  Box3f box;
  vec3 axes{0.0f};  ///< weighted by power
  float power = 0.0f, reach = 0.0f;
  std::uint32_t count = 0;

  void add(const LightBounds& light) {
    box.extend(light.box);
    if (!light.bothSides) {
      axes += light.axis * (light.power * 0.5f * (1.0f + std::cos(light.spread)));
    }
    power += light.power;
    reach = std::max(reach, light.reach);
    ++count;
  }
  void add(const Sum& other) {
    box.extend(other.box);
    axes += other.axes;
    power += other.power;
    reach = std::max(reach, other.reach);
    count += other.count;
  }
  /// Power times the measures of directions and of space.
  float cost() const {
    if (count == 0) return 0.0f;
    const float mean = std::min(glm::length(axes) / std::max(power, 1e-37f), 1.0f);
    const float spread = std::acos(std::clamp(2.0f * mean - 1.0f, -1.0f, 1.0f));
    const float end = std::min(spread + reach, kPi);
    const float sine = std::sin(spread), cosine = std::cos(spread);
    const float directions =
        2.0f * kPi * (1.0f - cosine) +
        0.5f * kPi *
            (2.0f * end * sine - std::cos(spread - 2.0f * end) - 2.0f * spread * sine + cosine);
    const vec3 size = box.size();
    return power * directions * (glm::dot(size, size) + 1e-20f);
  }
};

struct Split {
  int axis = -1;  ///< below 0: none tells the lights apart
  float at = 0.0f, cost = kInfinity;
};

}  // namespace

struct LightTree::Builder {
  /// Lights [first, first + count) of the order; the left child is the next node.
  struct Node {
    vec3 centre{0.0f};
    float radius = 0.0f;  ///< of the sphere around the box
    Directions directions;
    float power = 0.0f;
    std::uint32_t right = 0;  ///< 0: a leaf
    std::uint32_t first = 0, count = 0;
  };
  std::span<const LightBounds> lights;
  LightTree& tree;
  std::vector<Node> nodes;

  Split bestSplit(std::uint32_t first, std::uint32_t count, const Box3f& centres) const;
  bool shareLeaf(std::uint32_t first, std::uint32_t count) const;
  std::uint32_t divide(std::uint32_t first, std::uint32_t count) const;
  Directions build(std::uint32_t index, std::uint32_t first, std::uint32_t count);
  void widen(std::uint32_t root, std::uint32_t into) const;
  static void describe(const Node& node, LightNodes& out, std::uint32_t lane);
  const LightBounds& at(std::uint32_t place) const { return lights[tree.order_[place]]; }
};

Split LightTree::Builder::bestSplit(std::uint32_t first, std::uint32_t count,
                                    const Box3f& centres) const {
  const vec3 size = centres.size();
  const float longest = maxComponent(size);
  const std::uint32_t used = std::min(kMostBins, count);
  std::array<std::array<Sum, kMostBins>, 3> bins{};
  const vec3 scale = vec3(static_cast<float>(used)) / glm::max(size, vec3(1e-30f));
  for (std::uint32_t i = first; i < first + count; ++i) {
    const vec3 place = (at(i).box.centre() - centres.lower) * scale;
    for (int axis = 0; axis < 3; ++axis) {
      bins[axis][std::min(static_cast<std::uint32_t>(std::max(place[axis], 0.0f)), used - 1)].add(
          at(i));
    }
  }
  Split best;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(size[axis] > 1e-6f * longest)) continue;
    std::array<float, kMostBins> below{};
    Sum sum;
    for (std::uint32_t b = 0; b + 1 < used; ++b) {
      sum.add(bins[axis][b]);
      below[b] = sum.count > 0 ? sum.cost() : kInfinity;
    }
    sum = Sum();
    for (std::uint32_t b = used - 1; b > 0; --b) {
      sum.add(bins[axis][b]);
      if (sum.count == 0) continue;
      const float cost = (below[b - 1] + sum.cost()) * (longest / size[axis]);
      if (!(cost < best.cost)) continue;
      best = {axis, centres.lower[axis] + static_cast<float>(b) / scale[axis], cost};
    }
  }
  return best;
}

/// Whether these lights are chosen between by power alone: a few neighbours of one lamp in one
/// plane that overlap as much as the two halves of a rectangle.
bool LightTree::Builder::shareLeaf(std::uint32_t first, std::uint32_t count) const {
  if (count == 1) return true;
  if (count > kMostInLeaf || at(first).group == LightBounds::kAlone) return false;
  Box3f box;
  float apart = 0.0f, power = 0.0f;
  for (std::uint32_t i = first; i < first + count; ++i) {
    const LightBounds& light = at(i);
    if (light.group != at(first).group || glm::dot(light.axis, at(first).axis) < 0.99f) {
      return false;
    }
    box.extend(light.box);
    apart += light.power * glm::dot(light.box.size(), light.box.size());
    power += light.power;
  }
  return apart >= 0.5f * power * glm::dot(box.size(), box.size());
}

/// Sorts the lights into two sets; returns how many are in the first.
std::uint32_t LightTree::Builder::divide(std::uint32_t first, std::uint32_t count) const {
  if (count == 2) return 1;
  Box3f centres;
  for (std::uint32_t i = first; i < first + count; ++i) centres.extend(at(i).box.centre());
  const Split split = bestSplit(first, count, centres);
  const auto begin = tree.order_.begin() + first;
  if (split.axis >= 0) {
    const auto middle = std::partition(begin, begin + count, [&](std::uint32_t light) {
      return lights[light].box.centre()[split.axis] < split.at;
    });
    const auto left = static_cast<std::uint32_t>(middle - begin);
    if (left > 0 && left < count) return left;
  }
  return count / 2;
}

/// Nodes of n lights take up to 2n - 1 places from `index` on.
Directions LightTree::Builder::build(std::uint32_t index, std::uint32_t first,
                                     std::uint32_t count) {
  Node& node = nodes[index];
  Box3f box;
  double power = 0.0;
  for (std::uint32_t i = first; i < first + count; ++i) {
    box.extend(at(i).box);
    power += static_cast<double>(at(i).power);
  }
  node.centre = box.centre();
  node.radius = 0.5f * glm::length(box.size());
  node.power = static_cast<float>(power);
  Directions directions;
  if (shareLeaf(first, count)) {
    node.right = 0;
    for (std::uint32_t i = first; i < first + count; ++i) {
      directions = joined(directions, directionsOf(at(i)));
      tree.shares_[i] = static_cast<float>(static_cast<double>(at(i).power) / power);
    }
  } else {
    const std::uint32_t left = divide(first, count);
    node.right = index + 2 * left;
    Directions a, b;
    const auto buildLeft = [&] { a = build(index + 1, first, left); };
    const auto buildRight = [&] { b = build(node.right, first + left, count - left); };
    if (count > kSmallTask) {
      tbb::parallel_invoke(buildLeft, buildRight);
    } else {
      buildLeft();
      buildRight();
    }
    directions = joined(a, b);
  }
  node.directions = directions;
  node.first = first;
  node.count = count;
  return directions;
}

void LightTree::Builder::describe(const Node& node, LightNodes& out, std::uint32_t lane) {
  const Directions& d = node.directions;
  out.x[lane] = node.centre.x, out.y[lane] = node.centre.y, out.z[lane] = node.centre.z;
  out.radius[lane] = node.radius;
  out.axisX[lane] = d.axis.x, out.axisY[lane] = d.axis.y, out.axisZ[lane] = d.axis.z;
  out.power[lane] = node.power;
  out.cosSpread[lane] = d.spread >= kPi ? -1.0f : std::cos(d.spread);
  out.sinSpread[lane] = d.spread >= kPi ? 0.0f : std::sin(d.spread);
  out.cosReach[lane] = std::cos(d.reach);
  out.bothSides[lane] = d.bothSides ? 1.0f : 0.0f;
  out.first[lane] = node.first;
  out.count[lane] = node.count;
}

/// Puts up to eight nodes under `root` into a wide node: what is opened first matters most, bright
/// and large, or of many lights if all stand at one place. Then does the same for each.
void LightTree::Builder::widen(std::uint32_t root, std::uint32_t into) const {
  std::uint32_t children[LightNodes::kLanes] = {root};
  std::uint32_t count = 1;
  while (count < LightNodes::kLanes) {
    std::uint32_t* largest = nullptr;
    std::pair<float, std::uint32_t> most(-1.0f, 0);
    for (std::uint32_t i = 0; i < count; ++i) {
      const Node& node = nodes[children[i]];
      const std::pair<float, std::uint32_t> size(node.power * node.radius * node.radius,
                                                 node.count);
      if (node.right != 0 && size > most) largest = children + i, most = size;
    }
    if (largest == nullptr) break;
    children[count++] = nodes[*largest].right;
    ++*largest;
  }
  tree.nodes_[into].children = count;
  for (std::uint32_t i = 0; i < count; ++i) {
    const Node& node = nodes[children[i]];
    describe(node, tree.nodes_[into], i);
    if (node.right == 0) continue;
    const auto next = static_cast<std::uint32_t>(tree.nodes_.size());
    tree.nodes_.emplace_back();
    tree.nodes_[into].child[i] = next;
    widen(children[i], next);
  }
}

LightTree::LightTree(std::span<const LightBounds> lights) {
  if (lights.empty()) return;
  const auto count = static_cast<std::uint32_t>(lights.size());
  order_.resize(lights.size());
  shares_.resize(lights.size());
  place_.resize(lights.size());
  std::iota(order_.begin(), order_.end(), 0u);
  Builder builder{lights, *this, std::vector<Builder::Node>(2 * lights.size() - 1)};
  builder.build(0, 0, count);
  nodes_.emplace_back();
  builder.widen(0, 0);
  nodes_.shrink_to_fit();
  for (std::uint32_t i = 0; i < count; ++i) place_[order_[i]] = i;
}

}  // namespace trex
