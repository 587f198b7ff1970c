// The order in which a device takes cones: neighbours in space and direction stand together, so
// that the lanes of a subgroup read the same voxels and end at about the same time. Private to
// src/grays.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/grays/grid_tracer.h"
#include "src/grays/shaderio.h"

namespace trex {

/// Sorts batches of cones. One object a thread; keeps its memory.
class QueryOrder {
 public:
  /// `tracer` (its arrays are not read) must outlive it.
  explicit QueryOrder(const GridTracer& tracer) : tracer_(tracer) {}

  /// Copies queries to `out` (as many), each with its index: first those that start wide
  /// (asvoStartsWide), then the others; within them by octant of the direction and cell of the
  /// origin, in the order given. Returns how many start wide. Runs on the calling oneTBB arena;
  /// same result for any number of threads.
  std::uint32_t write(std::span<const shaderio::GatherQuery> queries, shaderio::GatherQuery* out);

 private:
  static constexpr std::uint32_t kCellBits = 3;  ///< an axis
  static constexpr std::uint32_t kKeys = 2u << (3 + 3 * kCellBits);
  static constexpr std::size_t kChunk = 1u << 16;
  std::uint16_t key(const shaderio::GatherQuery& query) const;

  const GridTracer& tracer_;
  std::vector<std::uint16_t> keys_;
  std::vector<std::uint32_t> places_;  ///< by chunk and key: where the next such query goes
};

}  // namespace trex
