// Memory layout of the ASVO, included by C++ (through GLM) and by GLSL. Version 1.
//
// The tree spans a cube: corner `lower` (render space, metres) and edge `size`. Level 0 is the
// root, level `depth` the leaves; a voxel of level l has edge size / 2^l. Nodes of all levels stand
// in one array, level by level (root first), within a level in Morton order, so that the children
// of a node are neighbours. A node's index is also its voxel's index. Leaves come last: leaf k is
// node firstLeaf + k. All leaves are on level `depth`.
//
//  nodes[i]     uvec2   x: index of the first child (0 for a leaf); y: bits 0..7 mask of children,
//  by
//                       octant (bit 0 x, bit 1 y, bit 2 z set = upper half)
//  voxels[i]    uvec4 x 2  see ASVO_VOXEL_*; index 2*i and 2*i+1
//  leaves[k]    uvec4   x, y: occupancy of 4x4x4 sub-voxels, bit x + 4y + 16z, lower word first
//                       z: plane normal, octahedral 2 x unorm16;
//                       w: plane offset from the voxel's centre along the normal in units of the
//                          voxel's edge (float bits), or ASVO_NO_PLANE if the content is not planar
//  light[i]     uvec4   irradiance (W/m^2) by side, rgb9e5: x front total, y back total, z front
//                       indirect, w back indirect. Front: light arriving against the voxel's
//                       normal.
#ifndef ASVO_LAYOUT_H
#define ASVO_LAYOUT_H

#ifdef __cplusplus
#include <cstdint>
#include <glm/glm.hpp>
namespace asvo {
using uint = std::uint32_t;
using glm::ivec3;
using glm::uvec2;
using glm::uvec3;
using glm::uvec4;
using glm::vec2;
using glm::vec3;
using glm::vec4;
#define ASVO_CONST static constexpr
#else
#define ASVO_CONST const
#endif

// voxels[2*i]:
//   x: projected coverage of faces whose normal points to +x, -x, +y, -y; 4 x unorm8, +x lowest
//   y: bits 0..15 coverage +z, -z; bits 16..31 dominant material
//   z: diffuse albedo, 3 x unorm8 (linear); bits 24..31 plane (0 in leaves): bits 24..28 its
//      offset from the centre along the normal, (value - 16) * 0.06 edges, or 0 for no plane; bits
//      29..31 how much of it is covered, (value + 1) / 8
//   w: normal, octahedral 2 x unorm16; area weighted, opposite faces sign-aligned
// voxels[2*i+1]:
//   x: emitted radiance of the front side, rgb9e5      y: of the back side
//   z: triangle area of the front side, m^2 (float bits)   w: of the back side
// The area of a side is the larger of the summed areas of faces along and against the normal: a
// single sheet receives light on both sides, a slab on each.
ASVO_CONST uint ASVO_NONE = 0xffffffffu;
ASVO_CONST uint ASVO_NO_PLANE = 0x7fc00000u;
ASVO_CONST uint ASVO_MAX_DEPTH = 12u;
/// Finest level in the tables of asvo_trace.h (128^3 entries, 8 MiB).
ASVO_CONST uint ASVO_MAX_GRID_LEVEL = 7u;
/// First code of an empty entry in them; node indices are below.
ASVO_CONST uint ASVO_GRID_EMPTY = 0x80000000u;

/// Header of a tree, as the tracer gets it; 32 bytes, std430.
struct AsvoInfo {
  float lowerX, lowerY, lowerZ;
  float size;
  uint depth;
  uint nodeCount;
  uint firstLeaf;
  uint leafCount;
};

#ifdef __cplusplus
static_assert(sizeof(AsvoInfo) == 32);
}  // namespace asvo
#endif
#endif
