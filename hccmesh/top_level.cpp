#include "hccmesh/top_level.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <utility>

namespace hccm {
namespace {

constexpr int kTopBins = 16;
constexpr std::size_t kExact = 128;  // boxes that are sorted instead of binned
constexpr int kMaxTopBinDepth = 24;  // beyond it the input is hostile to bins and is halved

struct Range {
  std::size_t begin, end;
  std::size_t count() const { return end - begin; }
};

class Builder {
 public:
  Builder(std::span<const GridBox> boxes, std::vector<TopNode>& nodes)
      : boxes_(boxes), nodes_(nodes), order_(boxes.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    if (!boxes.empty()) build({0, boxes.size()}, 0);
  }

 private:
  std::uint32_t build(const Range& range, int depth) {
    const auto number = static_cast<std::uint32_t>(nodes_.size());
    nodes_.emplace_back();
    std::array<Range, 8> parts{range};
    std::size_t count = 1;
    while (count < 8) {
      const std::size_t next = partToSplit(std::span(parts).first(count));
      if (next == count) break;
      const Range part = parts[next];
      const std::size_t middle = split(part, depth);
      parts[next] = {part.begin, middle};
      parts[count++] = {middle, part.end};
    }
    writeBoxes(nodes_[number], std::span(parts).first(count));
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t child = parts[i].count() == 1 ? TopNode::kCluster | order_[parts[i].begin]
                                                        : build(parts[i], depth + 1);
      nodes_[number].child[i] = child;
    }
    return number;
  }

  // The one with the largest surface of those that need more than a node; else of those that can be
  // taken apart to the end, which saves theirs. The number of parts if there is none.
  std::size_t partToSplit(std::span<const Range> parts) const {
    for (const bool large : {true, false}) {
      std::size_t best = parts.size();
      double most = -1.0;
      for (std::size_t i = 0; i < parts.size(); ++i) {
        const std::size_t count = parts[i].count();
        if (large ? count <= 8 : count < 2 || count > 9 - parts.size()) continue;
        const double surface = boundsOf(parts[i]).area();
        if (surface > most) most = surface, best = i;
      }
      if (best < parts.size()) return best;
    }
    return parts.size();
  }

  GridBox boundsOf(const Range& r) const {
    GridBox b = GridBox::empty();
    for (std::size_t i = r.begin; i < r.end; ++i) b.extend(boxes_[order_[i]]);
    return b;
  }

  std::int64_t centre(std::uint32_t box, int axis) const {
    return std::int64_t(boxes_[box].lower[axis]) + boxes_[box].upper[axis];
  }

  // Where the right part begins; neither part is empty.
  std::size_t split(const Range& r, int depth) {
    return r.count() <= kExact ? splitExactly(r) : splitByBins(r, depth);
  }

  // Every place in the order along every axis is tried; full nodes cost least.
  std::size_t splitExactly(const Range& r) {
    const auto first = order_.begin() + static_cast<std::ptrdiff_t>(r.begin);
    const auto last = order_.begin() + static_cast<std::ptrdiff_t>(r.end);
    const auto sortBy = [&](int axis) {
      std::sort(first, last, [&](std::uint32_t a, std::uint32_t b) {
        return std::pair(centre(a, axis), a) < std::pair(centre(b, axis), b);
      });
    };
    const auto weight = [](std::size_t n) { return static_cast<double>((n + 7) / 8 * 8); };
    std::array<double, kExact + 1> right{};
    int bestAxis = 0;
    std::size_t best = r.count() / 2;
    double leastCost = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      sortBy(axis);
      GridBox sum = GridBox::empty();
      for (std::size_t i = r.count() - 1; i > 0; --i) {
        sum.extend(boxes_[order_[r.begin + i]]);
        right[i] = sum.area() * weight(r.count() - i);
      }
      sum = GridBox::empty();
      for (std::size_t i = 1; i < r.count(); ++i) {
        sum.extend(boxes_[order_[r.begin + i - 1]]);
        const double cost = sum.area() * weight(i) + right[i];
        if (cost < leastCost) leastCost = cost, bestAxis = axis, best = i;
      }
    }
    sortBy(bestAxis);
    return r.begin + best;
  }

  std::size_t splitByBins(const Range& r, int depth) {
    const std::size_t half = r.begin + r.count() / 2;
    std::int64_t least[3], most[3];
    for (int k = 0; k < 3; ++k) {
      least[k] = std::numeric_limits<std::int64_t>::max(), most[k] = -least[k];
      for (std::size_t i = r.begin; i < r.end; ++i) {
        least[k] = std::min(least[k], centre(order_[i], k));
        most[k] = std::max(most[k], centre(order_[i], k));
      }
    }
    const auto binOf = [&](std::uint32_t box, int k) {
      return static_cast<int>((centre(box, k) - least[k]) * kTopBins / (most[k] - least[k] + 1));
    };
    int bestAxis = -1, bestBin = 0;
    double leastCost = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3 && depth < kMaxTopBinDepth; ++k) {
      if (least[k] == most[k]) continue;
      std::array<GridBox, kTopBins> box;
      std::array<std::size_t, kTopBins> count{};
      box.fill(GridBox::empty());
      for (std::size_t i = r.begin; i < r.end; ++i) {
        const auto bin = static_cast<std::size_t>(binOf(order_[i], k));
        box[bin].extend(boxes_[order_[i]]);
        ++count[bin];
      }
      std::array<double, kTopBins> right{};
      GridBox sum = GridBox::empty();
      std::size_t number = 0;
      for (std::size_t i = kTopBins - 1; i > 0; --i) {
        sum.extend(box[i]);
        right[i] = sum.area() * static_cast<double>(number += count[i]);
      }
      sum = GridBox::empty();
      number = 0;
      for (std::size_t i = 1; i < kTopBins; ++i) {
        sum.extend(box[i - 1]);
        number += count[i - 1];
        const double cost = right[i] + sum.area() * static_cast<double>(number);
        if (number == 0 || number == r.count() || cost >= leastCost) continue;
        leastCost = cost, bestAxis = k, bestBin = static_cast<int>(i);
      }
    }
    if (bestAxis < 0) return half;
    const auto first = order_.begin() + static_cast<std::ptrdiff_t>(r.begin);
    const auto middle =
        std::partition(first, order_.begin() + static_cast<std::ptrdiff_t>(r.end),
                       [&](std::uint32_t box) { return binOf(box, bestAxis) < bestBin; });
    return static_cast<std::size_t>(middle - order_.begin());
  }

  void writeBoxes(TopNode& node, std::span<const Range> parts) const {
    std::array<GridBox, 8> box;
    GridBox all = GridBox::empty();
    for (std::size_t i = 0; i < parts.size(); ++i) all.extend(box[i] = boundsOf(parts[i]));
    node = {};
    node.children = static_cast<std::uint8_t>(parts.size());
    for (int k = 0; k < 3; ++k) {
      const auto extent = static_cast<std::uint32_t>(all.upper[k] - all.lower[k]);
      std::uint32_t shift = 0;
      while (((extent + (1u << shift) - 1u) >> shift) > 255u) ++shift;
      node.lower[k] = all.lower[k];
      node.exponent[k] = static_cast<std::uint8_t>(127u + shift);
      for (std::size_t i = 0; i < parts.size(); ++i) {
        const auto low = static_cast<std::uint32_t>(box[i].lower[k] - all.lower[k]),
                   high = static_cast<std::uint32_t>(box[i].upper[k] - all.lower[k]);
        node.planes[2 * k][i] = static_cast<std::uint8_t>(low >> shift);
        node.planes[2 * k + 1][i] = static_cast<std::uint8_t>((high + (1u << shift) - 1u) >> shift);
      }
    }
  }

  std::span<const GridBox> boxes_;
  std::vector<TopNode>& nodes_;
  std::vector<std::uint32_t> order_;
};

}  // namespace

TopLevel::TopLevel(std::span<const GridBox> boxes) {
  Builder(boxes, nodes_);
  nodes_.shrink_to_fit();
}

}  // namespace hccm
