#include "src/grays/page_plan.h"

#include <algorithm>

#include "src/grays/shaderio.h"
#include "src/grays/tables.h"

namespace trex {
namespace {

constexpr std::uint64_t kNodeBytes = 32;  // brick or leaf, and what a cone reads
constexpr std::uint64_t kQueryBytes =
    sizeof(shaderio::GatherQuery) + sizeof(shaderio::GatherResult);
constexpr std::uint64_t kLeastQueries = 1024, kMostQueries = 1u << 20;
constexpr std::uint64_t kMostLoads = 256;         // pages staged for a batch
constexpr std::uint64_t kBufferSlack = 4096;      // a buffer's memory may be rounded up by that
constexpr std::uint64_t kBuffers = 16;            // that there are, at most
constexpr std::uint64_t kUploadBytes = 1u << 18;  // room for copies while starting, where staged
constexpr std::uint32_t kLeastGridLevel = 3;      // the coarsest that cones read
// Of the memory, for a finer grid, and for it and its voxels. Those are read anyway.
constexpr double kGridShare = 0.25, kFixedShare = 0.6;

class Planner {
 public:
  Planner(const asvo::Tree& tree, const PageLimits& limits, std::uint32_t pageBits)
      : tree_(tree), limits_(limits) {
    plan_.pageBits = pageBits;
    plan_.texels = limits.maxElements > 0;
    plan_.pages = pagesOf(tree.nodes.size());
  }

  PagePlan make() {
    const std::uint32_t most = coneGridLevel(tree_.info);
    const std::uint32_t least = std::min(most, kLeastGridLevel);
    plan_.queries = static_cast<std::uint32_t>(std::clamp(
        std::min({limits_.maxBytes / 8 / (2 * kQueryBytes), limits_.maxBuffer / kQueryBytes,
                  limits_.maxElements > 0 ? limits_.maxElements / 3 : kMostQueries}),
        kLeastQueries, kMostQueries));
    plan_.loads = static_cast<std::uint32_t>(
        std::clamp<std::uint64_t>(limits_.maxBytes / 32 / pageBytes(), 1, kMostLoads));
    // The finest grid with which all fits, else one that leaves most of the memory to pages.
    for (std::uint32_t level = most; level > least; --level) {
      if (gridBytes(level) <= limits_.maxBuffer && fill(level) && plan_.slots == plan_.pages) {
        return plan_;
      }
    }
    for (std::uint32_t level = most; level > least; --level) {
      const std::uint64_t grid = gridBytes(level);
      const std::uint64_t upper = pagesOf(tree_.levelOffsets[level + 1]) * pageBytes();
      if (share(grid) <= kGridShare && share(grid + upper) <= kFixedShare &&
          grid <= limits_.maxBuffer && fill(level)) {
        return plan_;
      }
    }
    if (fill(least)) return plan_;
    plan_.queries = kLeastQueries;
    plan_.loads = 1;
    fill(least);
    return plan_;
  }

 private:
  static std::uint64_t gridBytes(std::uint32_t level) { return std::uint64_t{8} << (3 * level); }
  double share(std::uint64_t bytes) const {
    return static_cast<double>(bytes) / static_cast<double>(limits_.maxBytes);
  }
  std::uint64_t pageBytes() const { return plan_.pageNodes() * kNodeBytes; }
  std::uint32_t pagesOf(std::uint64_t nodes) const {
    return static_cast<std::uint32_t>((nodes + plan_.pageNodes() - 1) >> plan_.pageBits);
  }

  /// All but the pool.
  std::uint64_t fixedBytes(std::uint32_t level) const {
    const std::uint64_t table = std::uint64_t{plan_.pages} * 4, marks = 2 * table;
    std::uint64_t bytes = gridBytes(level) + 2 * (table + marks + plan_.queries * kQueryBytes);
    if (limits_.staged) bytes += 2 * (table + plan_.loads * pageBytes()) + kUploadBytes;
    return bytes + kBuffers * kBufferSlack;
  }

  /// Slots that one buffer of the pool may have.
  std::uint64_t mostSlots() const {
    std::uint64_t nodes = limits_.maxBuffer / (kNodeBytes / 2);
    if (limits_.maxElements > 0) nodes = std::min(nodes, limits_.maxElements);
    return nodes >> plan_.pageBits;
  }

  /// Shares the memory out for a grid of that level. False if it is not enough: then the plan is
  /// the least with it.
  bool fill(std::uint32_t level) {
    plan_.gridLevel = level;
    const std::uint32_t upper = pagesOf(tree_.levelOffsets[level + 1]);
    const std::uint64_t least = std::min(plan_.pages, upper + 1);
    const std::uint64_t fixed = fixedBytes(level);
    const std::uint64_t left = limits_.maxBytes - std::min(limits_.maxBytes, fixed);
    const std::uint64_t slots =
        std::min<std::uint64_t>({plan_.pages, mostSlots(), left / pageBytes()});
    plan_.slots = static_cast<std::uint32_t>(std::max(slots, least));
    plan_.bytes = fixed + plan_.slots * pageBytes();
    plan_.largest = std::max<std::uint64_t>({plan_.slots * pageBytes() / 2, gridBytes(level),
                                             plan_.pages * 8ull,
                                             plan_.queries * sizeof(shaderio::GatherQuery)});
    plan_.resident =
        std::clamp(static_cast<std::uint32_t>(kResidentShare / share(pageBytes())), upper,
                   std::max(upper, plan_.slots - (plan_.slots < plan_.pages ? 1 : 0)));
    return slots >= least;
  }

  const asvo::Tree& tree_;
  PageLimits limits_;
  PagePlan plan_;
};

}  // namespace

PagePlan planPages(const asvo::Tree& tree, const PageLimits& limits, std::uint32_t pageBits) {
  return Planner(tree, limits, pageBits).make();
}

}  // namespace trex
