// The table of a tree's upper levels that lets the tracer start its descent in one read (ASVO_GRID
// of asvo_trace.h). Private to src/grays; derived from the tree, never stored.
#pragma once

#include <cstdint>
#include <vector>

#include "asvo/asvo.h"

namespace trex {

/// Finest level in the table: 64^3 entries, 2 MiB with all coarser levels.
inline constexpr std::uint32_t kGridLevel = 6;

inline std::uint32_t gridLevel(const asvo::AsvoInfo& info) {
  return info.depth < kGridLevel ? info.depth : kGridLevel;
}

/// 2 * 8^gridLevel entries. The tree must be valid and not empty.
std::vector<std::uint32_t> makeGrid(const asvo::Tree& tree);

}  // namespace trex
