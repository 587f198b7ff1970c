// The C++ build of the tracer with the tables of src/grays/tables.h, faster than asvo::Tracer and
// equal to it to the bit (tested). Private to src/grays.
#pragma once

#include "asvo/tracer.h"
#include "src/grays/tables.h"

// The text of the tracer is a class body; this is its second class.
#undef ASVO_TRACE_H

namespace trex {

namespace trace {

using asvo::ASVO_CONE_UNKNOWN;
using asvo::ASVO_GRID_EMPTY;
using asvo::ASVO_GRID_UNEVEN;
using asvo::ASVO_MAX_DEPTH;
using asvo::ASVO_MAX_GRID_LEVEL;
using asvo::ASVO_NONE;
using asvo::ASVO_PLANE_STEP;
using asvo::AsvoInfo;
using asvo::ivec3;
using asvo::uint;
using asvo::uvec2;
using asvo::uvec3;
using asvo::uvec4;
using asvo::vec3;
using asvo::trace::bitCount;
using asvo::trace::bitWidth;
using asvo::trace::floatBitsToUint;
using asvo::trace::uintBitsToFloat;
using glm::abs;
using glm::exp2;
using glm::log2;
using glm::max;
using glm::min;

/// Reads a tree, its tables and its light, all of which must outlive it. Thread safe.
class GridTracer {
 public:
  /// `gridLevel`: the finest of `grid`.
  GridTracer(const asvo::Tree& tree, std::uint32_t gridLevel, std::span<const std::uint32_t> grid,
             std::span<const uvec4> bricks, std::span<const uvec4> light,
             std::span<const uvec4> cones)
      : info_(tree.info),
        gridLevel_(gridLevel),
        firstBrick_(tree.info.leafCount > 0 ? firstBrick(tree) : 0),
        nodes_(tree.nodes.data()),
        voxels_(tree.voxels.data()),
        leaves_(tree.leaves.data()),
        grid_(grid.data()),
        bricks_(bricks.data()),
        light_(light.data()),
        cones_(cones.data()) {}

#define ASVO_NODE(i) (nodes_[i])
#define ASVO_VOXEL(i) (voxels_[i])
#define ASVO_LEAF(k) (leaves_[k])
#define ASVO_LIGHT(i) (light_[i])
#define ASVO_GRID(i) (grid_[i])
#define ASVO_BRICK(i) (bricks_[(i)-firstBrick_])
#define ASVO_CONE(i) (cones_[i])
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
#undef ASVO_GRID_LEVEL
#undef ASVO_INFO

 protected:
  AsvoInfo info_;
  uint gridLevel_, firstBrick_;
  const uvec2* nodes_;
  const uvec4* voxels_;
  const uvec2* leaves_;
  const std::uint32_t* grid_;
  const uvec4* bricks_;
  const uvec4* light_;
  const uvec4* cones_;
};

}  // namespace trace

using trace::GridTracer;

}  // namespace trex
