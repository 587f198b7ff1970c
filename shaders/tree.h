// The ASVO's buffers at set 0, bindings 0 to 4, and the tracer over them. GLSL only. The including
// shader declares `AsvoInfo` as push.info, the grid's level as push.gridLevel and the node of the
// first brick as push.firstBrick.
//
// With TREX_TEXELS they are uniform texel buffers, else storage buffers: software devices gather
// texels with vector instructions but fetch from storage buffers lane by lane (an eighth fewer
// instructions a cone on lavapipe 22.3).
#ifndef TREX_TREE_H
#define TREX_TREE_H

#ifdef TREX_TEXELS
#extension GL_EXT_samplerless_texture_functions : require
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
