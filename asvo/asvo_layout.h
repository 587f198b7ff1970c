// Memory layout of the ASVO, included by C++ (through GLM) and by GLSL. Version 3.
//
// The tree spans a cube: corner `lower` (render space, metres) and edge `size`. Level 0 is the
// root, level `depth` the leaves; a voxel of level l has edge size / 2^l. Nodes of all levels stand
// in one array, level by level (root first), within a level in Morton order, so that the children
// of a node are neighbours. A node's index is also its voxel's index. Leaves come last: leaf k is
// node firstLeaf + k. All leaves are on level `depth`.
//
//  nodes[i]     uvec2   x: index of the first child (0 for a leaf); y: bits 0..7 mask of children,
//                       by octant (bit 0 x, bit 1 y, bit 2 z set = upper half)
//  voxels[i]    uvec4   what every level knows of its content, see below
//  leaves[k]    uvec2   occupancy of 4x4x4 sub-voxels, bit x + 4y + 16z, lower word first
//  light[i]     uvec4   irradiance (W/m^2) by side, rgb9e5. x front, y back: of the faces of that
//                       side, for surface points. z front, w back: the same light over all faces of
//                       the voxel, for cones. Front: light arriving against the voxel's normal.
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

// voxels[i]:
//   x: projected coverage of faces whose normal points to +x, -x, +y, -y, +z; 5 x unorm6, +x
//      lowest; bits 30, 31 how much of the faces sends light by its direction, as metals do: 0 none
//      (less than 1/32), 1 some, 2 an eighth or more, 3 half or more
//   y: bits 0..5 coverage of -z; bits 6..31 normal, octahedral 2 x unorm13, x lowest; area
//      weighted, opposite faces sign-aligned
//   z: diffuse albedo, 3 x unorm8 (linear); bits 24..31 plane, 0 for none. In leaves: its offset
//      from the centre along the normal is (value - 128) * ASVO_PLANE_STEP edges. Above: bits
//      24..28 the offset, (value - 16) * 0.06 edges; bits 29..31 how much of it is covered,
//      (value + 1) / 8
//   w: bits 0..15 dominant material; bits 16..31 triangle area of a side in faces of the voxel: 0,
//      or (2048 + lower 11 bits) * 2^(upper 5 bits - 32), which is at most 5e-4 of it off
//      (of less than 5e-7: that)
// The area of a side is the larger of the summed areas of faces along and against the normal: a
// single sheet receives light on both sides, a slab on each.
ASVO_CONST uint ASVO_NONE = 0xffffffffu;
/// Unit of the plane offsets of leaves, in edges: half the diagonal of a voxel is 0.867.
ASVO_CONST float ASVO_PLANE_STEP = 0.0069f;
ASVO_CONST uint ASVO_MAX_DEPTH = 12u;
/// Finest level in the tables of asvo_trace.h (128^3 entries, 8 MiB).
ASVO_CONST uint ASVO_MAX_GRID_LEVEL = 7u;
/// First code of an empty entry in them; node indices are below.
ASVO_CONST uint ASVO_GRID_EMPTY = 0x80000000u;
/// Bit of an entry of a voxel above the finest table that is uneven; node indices are below that.
ASVO_CONST uint ASVO_GRID_UNEVEN = 0x40000000u;
/// Bit of the second of a voxel's cone words: voxels do not know what it sends out.
ASVO_CONST uint ASVO_CONE_UNKNOWN = 0x40000000u;

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
