#include "hccmesh/split.h"

#include <hwy/highway.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <limits>

namespace hccm {
namespace {

namespace hn = hwy::HWY_NAMESPACE;  // the baseline target: builds are bit-equal everywhere
using D4 = hn::FixedTag<float, 4>;
using V4 = hn::Vec<D4>;

constexpr float kInf = std::numeric_limits<float>::infinity();

// A box in two registers; the fourth lane is of no meaning.
struct Box4 {
  V4 lower = hn::Set(D4(), kInf), upper = hn::Set(D4(), -kInf);
  void extend(V4 l, V4 u) {
    lower = hn::Min(lower, l);
    upper = hn::Max(upper, u);
  }
  void extend(const Reference& r) { extend(hn::Load(D4(), r.lower), hn::Load(D4(), r.upper)); }
  // Half the surface; 0 if empty.
  float area() const {
    alignas(16) float e[4];
    hn::Store(hn::Sub(upper, lower), D4(), e);
    return e[0] < 0.0f ? 0.0f : e[0] * e[1] + e[1] * e[2] + e[2] * e[0];
  }
};

constexpr int kBins = 32;
constexpr std::size_t kParallel = 1u << 15;  // references that are worth a task

struct alignas(16) Bin {
  float lower[4] = {kInf, kInf, kInf, kInf}, upper[4] = {-kInf, -kInf, -kInf, -kInf};
  std::size_t count = 0;
};
struct Bins {
  Bin bin[3][kBins];
  void merge(const Bins& other) {
    for (int axis = 0; axis < 3; ++axis)
      for (int i = 0; i < kBins; ++i) {
        Bin& a = bin[axis][i];
        const Bin& b = other.bin[axis][i];
        for (int k = 0; k < 4; ++k) {
          a.lower[k] = std::min(a.lower[k], b.lower[k]);
          a.upper[k] = std::max(a.upper[k], b.upper[k]);
        }
        a.count += b.count;
      }
  }
};

// Twice the centroid's bounds.
struct Centroids {
  alignas(16) float lower[4] = {kInf, kInf, kInf, kInf};
  alignas(16) float upper[4] = {-kInf, -kInf, -kInf, -kInf};
};

Centroids centroidsOf(std::span<const Reference> r) {
  Box4 box;
  for (const Reference& x : r) {
    const V4 c = hn::Add(hn::Load(D4(), x.lower), hn::Load(D4(), x.upper));
    box.extend(c, c);
  }
  Centroids c;
  hn::Store(box.lower, D4(), c.lower);
  hn::Store(box.upper, D4(), c.upper);
  return c;
}

struct BinFrame {
  float least[3], scale[3];
  explicit BinFrame(const Centroids& c) {
    for (int k = 0; k < 3; ++k) {
      const float extent = c.upper[k] - c.lower[k];
      least[k] = c.lower[k];
      scale[k] = extent > 0.0f ? static_cast<float>(kBins) * 0.999999f / extent : 0.0f;
    }
  }
  int binOf(const Reference& r, int axis) const {
    return static_cast<int>((r.lower[axis] + r.upper[axis] - least[axis]) * scale[axis]);
  }
};

void fillBins(std::span<const Reference> references, const BinFrame& frame, Bins& bins) {
  for (const Reference& r : references) {
    const V4 lower = hn::Load(D4(), r.lower), upper = hn::Load(D4(), r.upper);
    for (int axis = 0; axis < 3; ++axis) {
      Bin& b = bins.bin[axis][frame.binOf(r, axis)];
      hn::Store(hn::Min(hn::Load(D4(), b.lower), lower), D4(), b.lower);
      hn::Store(hn::Max(hn::Load(D4(), b.upper), upper), D4(), b.upper);
      ++b.count;
    }
  }
}

template <typename Value, typename Body, typename Join>
Value reduce(std::span<const Reference> r, Value start, const Body& body, const Join& join) {
  if (r.size() < kParallel) return body(r, start);
  return tbb::parallel_reduce(
      tbb::blocked_range<std::size_t>(0, r.size(), kParallel / 2), start,
      [&](const tbb::blocked_range<std::size_t>& range, Value value) {
        return body(r.subspan(range.begin(), range.size()), std::move(value));
      },
      join);
}

struct BinSplit {
  int axis = -1, bin = 0;  // left: bins below
};

BinSplit bestBinSplit(const Bins& bins) {
  BinSplit best;
  float least = kInf;
  for (int axis = 0; axis < 3; ++axis) {
    float cost[kBins] = {};
    Box4 box;
    std::size_t count = 0;
    for (int i = kBins - 1; i > 0; --i) {
      const Bin& b = bins.bin[axis][i];
      box.extend(hn::Load(D4(), b.lower), hn::Load(D4(), b.upper));
      count += b.count;
      cost[i] = count == 0 ? kInf : box.area() * static_cast<float>(count);
    }
    box = Box4();
    count = 0;
    for (int i = 1; i < kBins; ++i) {
      const Bin& b = bins.bin[axis][i - 1];
      box.extend(hn::Load(D4(), b.lower), hn::Load(D4(), b.upper));
      count += b.count;
      const float total = cost[i] + box.area() * static_cast<float>(count);
      if (count > 0 && total < least) {
        least = total;
        best = {axis, i};
      }
    }
  }
  return best;
}

// Where the right half begins, after moving the left one to the front.
std::size_t partitionByBins(std::span<Reference> references) {
  const Centroids c = reduce(
      std::span<const Reference>(references), Centroids(),
      [](std::span<const Reference> part, Centroids value) {
        const Centroids add = centroidsOf(part);
        for (int k = 0; k < 3; ++k) {
          value.lower[k] = std::min(value.lower[k], add.lower[k]);
          value.upper[k] = std::max(value.upper[k], add.upper[k]);
        }
        return value;
      },
      [](Centroids a, const Centroids& b) {
        for (int k = 0; k < 3; ++k) {
          a.lower[k] = std::min(a.lower[k], b.lower[k]);
          a.upper[k] = std::max(a.upper[k], b.upper[k]);
        }
        return a;
      });
  const BinFrame frame(c);
  const Bins bins = reduce(
      std::span<const Reference>(references), Bins(),
      [&](std::span<const Reference> part, Bins value) {
        fillBins(part, frame, value);
        return value;
      },
      [](Bins a, const Bins& b) {
        a.merge(b);
        return a;
      });
  const BinSplit split = bestBinSplit(bins);
  if (split.axis < 0) return references.size() / 2;  // all centroids are one
  const auto middle = std::partition(references.begin(), references.end(), [&](const Reference& r) {
    return frame.binOf(r, split.axis) < split.bin;
  });
  return static_cast<std::size_t>(middle - references.begin());
}

// Beyond this depth the input is hostile to bins and is cut in the middle.
constexpr int kMaxBinDepth = 48;

void splitTop(std::span<Reference> all, Range range, std::size_t pieceSize, int depth,
              std::vector<Range>& out) {
  const std::size_t count = range.end - range.begin;
  if (count <= pieceSize) {
    if (count > 0) out.push_back(range);
    return;
  }
  const std::size_t middle =
      range.begin +
      (depth < kMaxBinDepth ? partitionByBins(all.subspan(range.begin, count)) : count / 2);
  if (count < kParallel) {
    splitTop(all, {range.begin, middle}, pieceSize, depth + 1, out);
    splitTop(all, {middle, range.end}, pieceSize, depth + 1, out);
    return;
  }
  std::vector<Range> right;
  tbb::parallel_invoke(
      [&] {
        splitTop(all, {range.begin, middle}, pieceSize, depth + 1, out);
      },
      [&] {
        splitTop(all, {middle, range.end}, pieceSize, depth + 1, right);
      });
  out.insert(out.end(), right.begin(), right.end());
}

float ceilTo(std::size_t count, std::size_t unit) {
  return static_cast<float>((count + unit - 1) / unit * unit);
}

}  // namespace

std::vector<Range> splitIntoPieces(std::span<Reference> references, std::size_t pieceSize) {
  std::vector<Range> pieces;
  splitTop(references, {0, references.size()}, pieceSize, 0, pieces);
  return pieces;
}

PieceSplitter::PieceSplitter(std::span<const Reference> piece, const SplitLimits& limits)
    : piece_(piece),
      limits_(limits),
      scratch_(piece.size()),
      areas_(piece.size()),
      side_(piece.size()) {
  std::vector<std::uint64_t> keys(piece.size());
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < piece.size(); ++i) {
      const auto centroid = static_cast<std::int64_t>(piece[i].lower[axis] + piece[i].upper[axis]);
      keys[i] = static_cast<std::uint64_t>(centroid + (1 << 25)) << 16 | i;
    }
    std::sort(keys.begin(), keys.end());
    order_[axis].resize(piece.size());
    for (std::size_t i = 0; i < keys.size(); ++i) order_[axis][i] = static_cast<Index>(keys[i]);
  }
  if (!piece.empty()) pending_.push_back({0, piece.size()});
}

template <typename Cost>
PieceSplitter::Split PieceSplitter::bestSplit(const Range& range, std::size_t stride,
                                              const Cost& cost) {
  const std::size_t count = range.end - range.begin;
  Split best{0, count / 2};
  float least = kInf;
  for (int axis = 0; axis < 3; ++axis) {
    const Index* order = order_[axis].data() + range.begin;
    Box4 box;
    for (std::size_t i = count - 1; i > 0; --i) {
      box.extend(piece_[order[i]]);
      if (i % stride == 0) areas_[i] = box.area();
    }
    box = Box4();
    for (std::size_t i = 1; i < count; ++i) {
      box.extend(piece_[order[i - 1]]);
      if (i % stride != 0) continue;
      const float total = cost(box.area(), i, areas_[i], count - i);
      if (total < least) {
        least = total;
        best = {axis, i};
      }
    }
  }
  return best;
}

void PieceSplitter::partition(const Range& range, const Split& split) {
  const std::size_t count = range.end - range.begin;
  const Index* chosen = order_[split.axis].data() + range.begin;
  for (std::size_t i = 0; i < count; ++i) side_[chosen[i]] = i >= split.position;
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == split.axis) continue;
    Index* order = order_[axis].data() + range.begin;
    std::size_t left = 0, right = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Index triangle = order[i];
      scratch_[right] = triangle;
      order[left] = triangle;
      right += side_[triangle];
      left += 1u - side_[triangle];
    }
    std::copy_n(scratch_.begin(), right, order + left);
  }
}

bool PieceSplitter::nextCluster(Range& cluster) {
  if (pending_.empty()) return false;
  while (pending_.back().end - pending_.back().begin > limits_.triangles) {
    const Range range = pending_.back();
    pending_.pop_back();
    // Full clusters take least memory, small surfaces least time.
    const std::size_t full = limits_.triangles;
    const Split split =
        bestSplit(range, layout::kLeafSize, [full](float a, std::size_t m, float b, std::size_t n) {
          const auto weight = [full](std::size_t c) {
            return static_cast<float>(c) + ceilTo(c, full);
          };
          return a * weight(m) + b * weight(n);
        });
    partition(range, split);
    pending_.push_back({range.begin + split.position, range.end});
    pending_.push_back({range.begin, range.begin + split.position});
  }
  cluster = pending_.back();
  pending_.pop_back();
  return true;
}

void PieceSplitter::refuse(const Range& cluster) {
  const Split split{0, (cluster.end - cluster.begin) / 2};
  partition(cluster, split);
  pending_.push_back({cluster.begin + split.position, cluster.end});
  pending_.push_back({cluster.begin, cluster.begin + split.position});
}

std::vector<std::uint16_t> PieceSplitter::splitIntoLeaves(const Range& cluster, const Fits& fits) {
  // A few leaves more than needed let large triangles lie alone.
  const std::size_t needed =
      (cluster.end - cluster.begin + layout::kLeafSize - 1) / layout::kLeafSize;
  const std::size_t budget =
      std::min(needed + (needed + limits_.spareLeaves / 2) / limits_.spareLeaves, limits_.leaves);
  std::vector<std::uint16_t> starts;
  splitLeaves(cluster, budget, cluster.begin, fits, starts);
  return starts;
}

void PieceSplitter::splitLeaves(const Range& range, std::size_t budget, std::size_t base,
                                const Fits& fits, std::vector<std::uint16_t>& starts) {
  const std::size_t count = range.end - range.begin;
  if (count <= layout::kLeafSize && fits(triangles(range))) {
    starts.push_back(static_cast<std::uint16_t>(range.begin - base));
    return;
  }
  const auto leaves = [](std::size_t n) { return (n + layout::kLeafSize - 1) / layout::kLeafSize; };
  const Split split = bestSplit(range, 1, [&](float a, std::size_t m, float b, std::size_t n) {
    if (leaves(m) + leaves(n) > std::max<std::size_t>(budget, 2)) return kInf;
    return a * ceilTo(m, layout::kLeafSize) + b * ceilTo(n, layout::kLeafSize);
  });
  partition(range, split);
  const std::size_t left = leaves(split.position), right = leaves(count - split.position);
  const std::size_t spare = budget > left + right ? budget - left - right : 0;
  const std::size_t forLeft = left + spare * left / (left + right);
  const std::size_t middle = range.begin + split.position;
  splitLeaves({range.begin, middle}, forLeft, base, fits, starts);
  splitLeaves({middle, range.end}, std::max(budget, forLeft) - forLeft, base, fits, starts);
}

}  // namespace hccm
