// The ASVO's buffers at set 0, bindings 0 to 4, and the tracer over them. GLSL only. The including
// shader declares `AsvoInfo` as push.info, the grid's level as push.gridLevel and the node of the
// first brick as push.firstBrick.
//
// With TREX_TEXELS they are uniform texel buffers, else storage buffers: software devices gather
// texels with vector instructions but fetch from storage buffers lane by lane (an eighth fewer
// instructions a cone on lavapipe 22.3).
//
// With TREX_PAGED only pages of the tree are there (src/grays/page_table.h), in slots of two pools:
// bindings 0 and 1 are the bricks of inner voxels and the leaves of leaf voxels, and the cone
// words, both by slot; 2 is the page table; 3 the grid; the last (kMarksBinding) the marks, two
// words a page: whether it was read, and how often it was missing. The pages of the voxels in the
// grid have the slots of their numbers.
#ifndef TREX_TREE_H
#define TREX_TREE_H

#ifdef TREX_TEXELS
#extension GL_EXT_samplerless_texture_functions : require
#endif

#ifdef TREX_PAGED
layout(constant_id = 2) const uint kPageBits = 10u;  // of the number of a page's voxels
#ifdef TREX_TEXELS
layout(set = 0, binding = 0) uniform utextureBuffer details;
layout(set = 0, binding = 1) uniform utextureBuffer cones;
layout(set = 0, binding = 2) uniform utextureBuffer pageTable;
layout(set = 0, binding = 3) uniform utextureBuffer grid;
#define TREX_DETAIL(i) texelFetch(details, int(i))
#define TREX_PAGE(i) texelFetch(pageTable, int(i)).x
#define ASVO_CONE(i) texelFetch(cones, int(i))
#define ASVO_GRID(i) texelFetch(grid, int(i)).x
#else
layout(std430, set = 0, binding = 0) readonly buffer DetailBuffer { uvec4 details[]; };
layout(std430, set = 0, binding = 1) readonly buffer ConeBuffer { uvec4 cones[]; };
layout(std430, set = 0, binding = 2) readonly buffer PageBuffer { uint pageTable[]; };
layout(std430, set = 0, binding = 3) readonly buffer GridBuffer { uint grid[]; };
#define TREX_DETAIL(i) details[i]
#define TREX_PAGE(i) pageTable[i]
#define ASVO_CONE(i) cones[i]
#define ASVO_GRID(i) grid[i]
#endif
layout(std430, set = 0, binding = kMarksBinding) buffer MarkBuffer { uint marks[]; };

// Where a voxel that is there stands in the pools.
uint pagedPlace(uint voxel) {
  return (TREX_PAGE(voxel >> kPageBits) << kPageBits) | (voxel & ((1u << kPageBits) - 1u));
}
bool pagedResident(uint voxel) {
  uint page = voxel >> kPageBits;
  bool there = TREX_PAGE(page) != kNoSlot;
  if (there) {
    marks[2u * page] = 1u;  // whoever writes writes the same
  } else {
    atomicAdd(marks[2u * page + 1u], 1u);
  }
  return there;
}
#define ASVO_RESIDENT(i) pagedResident(i)
#define ASVO_CONE_FINE(i) ASVO_CONE(pagedPlace(i))
#define ASVO_BRICK(i) TREX_DETAIL(pagedPlace(i))
#define ASVO_LEAF(k) TREX_DETAIL(pagedPlace(push.info.firstLeaf + (k))).xy
#define ASVO_VOXEL(i) uvec4(0u)  // not there: nothing that a cone calls reads it
#elif defined(TREX_TEXELS)
layout(set = 0, binding = 0) uniform utextureBuffer bricks;
layout(set = 0, binding = 1) uniform utextureBuffer voxels;
layout(set = 0, binding = 2) uniform utextureBuffer leaves;
layout(set = 0, binding = 3) uniform utextureBuffer cones;
layout(set = 0, binding = 4) uniform utextureBuffer grid;
#define ASVO_BRICK(i) texelFetch(bricks, int((i)-push.firstBrick))
#define ASVO_VOXEL(i) texelFetch(voxels, int(i))
#define ASVO_LEAF(k) texelFetch(leaves, int(k)).xy
#define ASVO_CONE(i) texelFetch(cones, int(i))
#define ASVO_GRID(i) texelFetch(grid, int(i)).x
#else
layout(std430, set = 0, binding = 0) readonly buffer BrickBuffer { uvec4 bricks[]; };
layout(std430, set = 0, binding = 1) readonly buffer VoxelBuffer { uvec4 voxels[]; };
layout(std430, set = 0, binding = 2) readonly buffer LeafBuffer { uvec2 leaves[]; };
layout(std430, set = 0, binding = 3) readonly buffer ConeBuffer { uvec4 cones[]; };
layout(std430, set = 0, binding = 4) readonly buffer GridBuffer { uint grid[]; };
#define ASVO_BRICK(i) bricks[(i)-push.firstBrick]
#define ASVO_VOXEL(i) voxels[i]
#define ASVO_LEAF(k) leaves[k]
#define ASVO_CONE(i) cones[i]
#define ASVO_GRID(i) grid[i]
#endif
#define ASVO_GRID_LEVEL push.gridLevel
#define ASVO_INFO push.info
#include "asvo/asvo_trace.h"

#endif
