// The C++ build of the tracer with pages (ASVO_RESIDENT): the oracle of the paged shader, over the
// page table that the device saw.
#pragma once

#include "src/grays/grid_tracer.h"

#undef ASVO_TRACE_H

namespace trex::test {

using namespace trace;  // names that the text of the tracer needs

/// Reads a tree as far as `table` (a slot a page of 2^pageBits nodes, or kNoSlot) has it.
class PagedOracle {
 public:
  PagedOracle(const asvo::Tree& tree, std::uint32_t gridLevel, std::span<const uvec4> cones,
              std::span<const std::uint32_t> table, std::uint32_t pageBits)
      : tree_(tree),
        info_(tree.info),
        gridLevel_(gridLevel),
        pageBits_(pageBits),
        grid_(makeGrid(tree, gridLevel)),
        cones_(cones),
        table_(table.begin(), table.end()) {}

  bool resident(uint voxel) const {
    const bool there = table_[voxel >> pageBits_] != shaderio::kNoSlot;
    missed += there ? 0 : 1;
    return there;
  }
  mutable std::uint64_t missed = 0;

#define ASVO_NODE(i) (tree_.nodes[i])
#define ASVO_VOXEL(i) (tree_.voxels[i])
#define ASVO_LEAF(k) (tree_.leaves[k])
#define ASVO_LIGHT(i) uvec4(0u)
#define ASVO_GRID(i) (grid_[i])
#define ASVO_BRICK(i) brickOf(tree_, i)
#define ASVO_CONE(i) (cones_[i])
#define ASVO_RESIDENT(i) resident(i)
#define ASVO_GRID_LEVEL gridLevel_
#define ASVO_INFO info_
#include "asvo/asvo_trace.h"
#undef ASVO_NODE
#undef ASVO_VOXEL
#undef ASVO_LEAF
#undef ASVO_LIGHT
#undef ASVO_GRID
#undef ASVO_BRICK
#undef ASVO_CONE
#undef ASVO_CONE_FINE
#undef ASVO_FINE
#undef ASVO_RESIDENT
#undef ASVO_GRID_LEVEL
#undef ASVO_INFO

 private:
  const asvo::Tree& tree_;
  AsvoInfo info_;
  uint gridLevel_, pageBits_;
  std::vector<std::uint32_t> grid_;
  std::span<const uvec4> cones_;
  std::vector<std::uint32_t> table_;
};

}  // namespace trex::test
