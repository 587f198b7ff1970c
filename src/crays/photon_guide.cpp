#include "src/crays/photon_guide.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr std::size_t kMostPoints = 1u << 17;  // enough known: later photons teach nothing new
constexpr std::size_t kFewestPoints = 32;      // before that the guide stays uniform
constexpr std::uint32_t kLeafPoints = 16;
constexpr int kMostCuts = 16;   // of one dimension: a room in a city of kilometres
constexpr float kWide = 0.01f;  // moment of a wide hint; that of others is 1 on average

}  // namespace

ImportanceMap::ImportanceMap(const Box3f& bounds, std::span<const Mark> marks) {
  if (bounds.empty() || marks.empty()) return;
  lower_ = bounds.lower;
  perMetre_ = 1.0f / std::max(maxComponent(bounds.size()), 1e-20f);
  fine_.assign(std::size_t{kFine} * kFine * kFine * 6, 0);
  coarse_.assign(std::size_t{kCoarse} * kCoarse * kCoarse * 6, 0);
  for (const Mark& mark : marks) {
    for (std::uint16_t* count : {&fine_[cell(vec3(mark.start.position), mark.normal, kFine)],
                                 &coarse_[cell(vec3(mark.start.position), mark.normal, kCoarse)]}) {
      if (*count < 0xffffu) ++*count;
    }
  }
  for (const Mark& mark : marks) {
    readers_.push_back({mark.start, mark.normal, visits(vec3(mark.start.position), mark.normal)});
    for (std::uint32_t i = 0; i < mark.escapes; ++i) {
      escapes_.push_back({mark.origin[i], mark.direction[i], readers_.back().visits});
    }
  }
}

/// The number of a cell: walls are thinner than cells, so their two sides are told apart by normal.
std::uint32_t ImportanceMap::cell(const vec3& position, const vec3& normal,
                                  std::uint32_t cells) const {
  std::uint32_t number = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const float at = (position[axis] - lower_[axis]) * perMetre_ * static_cast<float>(cells);
    const auto last = static_cast<float>(cells - 1);
    // Written so that NaN falls into cell 0.
    number = number * cells + static_cast<std::uint32_t>(at > 0.0f ? std::min(at, last) : 0.0f);
  }
  const vec3 size = glm::abs(normal);
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  return number * 6 + static_cast<std::uint32_t>(axis) * 2 + (normal[axis] < 0.0f ? 1 : 0);
}

float ImportanceMap::visits(const vec3& position, const vec3& normal) const {
  if (fine_.empty()) return 0.0f;
  constexpr float kPerFine = static_cast<float>(kCoarse * kCoarse) / (kFine * kFine);  // surfaces
  return 0.5f * (static_cast<float>(fine_[cell(position, normal, kFine)]) +
                 static_cast<float>(coarse_[cell(position, normal, kCoarse)]) * kPerFine);
}

float EmissionGuide::warp(float choice, vec4& primary) const {
  if (leaves_.empty()) return 1.0f;
  const double target = static_cast<double>(choice) * cumulative_.back();
  const auto at = std::upper_bound(cumulative_.begin(), cumulative_.end(), target);
  const auto index =
      std::min(static_cast<std::size_t>(at - cumulative_.begin()), leaves_.size() - 1);
  const Leaf& leaf = leaves_[index];
  primary = glm::min(leaf.lower + leaf.size * primary, vec4(0x1.fffffep-1f));
  return leaf.density;
}

void EmissionGuide::learn(const vec4& primary, float density, float value) {
  if (dimensions_ == 0 || !(value > 0.0f)) return;
  const float moment = value * value / density;
  // A photon that lands again: one point. Boxes are cut by the number of points, and the few
  // photons of a white room, each told many times, would leave leaves between them without any;
  // these get no photons for it, and learn no more, until one of the uniform share brings what all
  // should have.
  if (!learnt_.empty() && learnt_.back().primary == primary) {
    learnt_.back().moment += moment;
  } else if (learnt_.size() < kMostPoints) {
    learnt_.push_back({primary, moment});
  }
}

void EmissionGuide::hint(const vec4& primary, float weight) {
  if (dimensions_ == 0 || hints_.size() >= kMostPoints || !(weight > 0.0f)) return;
  hints_.push_back({primary, weight});
}

void EmissionGuide::hintWide(const vec4& primary) {
  if (dimensions_ == 0 || wide_.size() >= kMostPoints) return;
  wide_.push_back({primary, kWide});
}

double EmissionGuide::sumMoments(std::uint32_t first, std::uint32_t last) const {
  double sum = 0.0;
  for (std::uint32_t i = first; i < last; ++i) sum += static_cast<double>(points_[i].moment);
  return sum;
}

/// The dimension along which the points of a box are spread least evenly, by the chi-square of
/// eight slices (two halves alike would hide a peak in the middle). -1 if the box stays whole.
int EmissionGuide::chooseCut(const Node& node) const {
  if (node.last - node.first < kLeafPoints) return -1;
  int best = -1;
  double uneven = 0.0;
  for (int axis = 0; axis < dimensions_; ++axis) {
    if (node.cuts[static_cast<std::size_t>(axis)] >= kMostCuts) continue;
    std::array<std::uint32_t, 8> slices{};
    for (std::uint32_t i = node.first; i < node.last; ++i) {
      const float x = (points_[i].primary[axis] - node.lower[axis]) / node.size[axis];
      ++slices[static_cast<std::size_t>(std::clamp(x * 8.0f, 0.0f, 7.0f))];
    }
    double squares = 0.0;
    for (const std::uint32_t n : slices) squares += static_cast<double>(n) * n;
    // Among equals the longest side, so that boxes stay compact.
    squares *= 1.0 + 0.25 * static_cast<double>(node.size[axis]);
    if (squares > uneven) {
      uneven = squares;
      best = axis;
    }
  }
  return best;
}

/// Halves a box; the first half is opened next, so that the order of leaves is fixed.
void EmissionGuide::cut(const Node& node, int axis, std::vector<Node>& open) {
  const float middle = node.lower[axis] + 0.5f * node.size[axis];
  const auto begin = points_.begin() + node.first, end = points_.begin() + node.last;
  const auto split =
      std::stable_partition(begin, end, [&](const Point& p) { return p.primary[axis] < middle; });
  Node low = node, high = node;
  low.size[axis] = high.size[axis] = 0.5f * node.size[axis];
  high.lower[axis] = middle;
  low.last = high.first = static_cast<std::uint32_t>(split - points_.begin());
  for (Node* half : {&high, &low}) {
    half->moment = sumMoments(half->first, half->last);
    ++half->cuts[static_cast<std::size_t>(axis)];
    open.push_back(*half);
  }
}

void EmissionGuide::update() {
  const std::size_t known = hints_.size() + learnt_.size();
  const bool begins = leaves_.empty() && known + wide_.size() >= kFewestPoints;
  if (!begins && known < std::max(kFewestPoints, built_ + built_ / 2)) return;
  built_ = known;
  leaves_.clear();
  // Hints and photons tell the same, each in a unit of its own: they count by their numbers.
  points_.clear();
  for (const auto* from : {&hints_, &learnt_}) {
    double sum = 0.0;
    for (const Point& p : *from) sum += static_cast<double>(p.moment);
    const auto unit = static_cast<float>(static_cast<double>(from->size()) / sum);
    for (const Point& p : *from) points_.push_back({p.primary, p.moment * unit});
  }
  points_.insert(points_.end(), wide_.begin(), wide_.end());
  const auto count = static_cast<std::uint32_t>(points_.size());
  const double all = sumMoments(0, count);
  std::vector<Node> open{{0, count, vec4(0.0f), vec4(1.0f), all, {}}};
  std::vector<double> shares;
  double sum = 0.0;
  while (!open.empty()) {
    const Node node = open.back();
    open.pop_back();
    const int axis = chooseCut(node);
    if (axis >= 0) {
      cut(node, axis, open);
      continue;
    }
    // A density in proportion to the root of the mean moment gives the least variance, since a
    // photon's power is one over the density.
    const double volume =
        static_cast<double>(node.size.x) * node.size.y * node.size.z * node.size.w;
    shares.push_back(std::sqrt(volume * node.moment));
    sum += shares.back();
    leaves_.push_back({node.lower, node.size, static_cast<float>(volume)});
  }
  cumulative_.clear();
  double before = 0.0;
  for (std::size_t i = 0; i < leaves_.size(); ++i) {
    const double volume = leaves_[i].density;
    const double chance = kUniformShare * volume + (1.0 - kUniformShare) * shares[i] / sum;
    leaves_[i].density = static_cast<float>(chance / volume);
    cumulative_.push_back(before += chance);
  }
}

}  // namespace trex
