// The ASVO tracer: one text, compiled as GLSL and, through GLM, as C++. [Crassin et al. 2011,
// cones; Laine and Karras 2010, planes in voxels; Amanatides and Woo 1987, grid traversal]
//
// C++:  included inside the body of class Tracer (tracer.h), so the functions are its members.
// GLSL: the shader declares its buffers, defines the accessors, then includes this file:
//
//     ASVO_NODE(i) uvec2    ASVO_VOXEL(i) uvec4    ASVO_LEAF(k) uvec2
//     ASVO_LIGHT(i) uvec4   ASVO_INFO AsvoInfo                               (see asvo_layout.h)
//
// For speed the includer defines tables derived from the tree (src/grays/tables.h); without them
// the same answers come from the nodes, slowly: the oracle of the tests.
//
//     ASVO_GRID(i)   the levels up to ASVO_GRID_LEVEL as arrays: entry 8^l + x + 2^l y + 4^l z
//                    is the voxel at that place of level l, with ASVO_GRID_UNEVEN if it is uneven
//                    and finer tables follow; or ASVO_GRID_EMPTY and, in 3 bits for each octant o
//                    at 3 o, e: the cube of (e + 1)^3 places from here in that direction is empty
//     ASVO_BRICK(i)  uvec4 of each inner voxel from level ASVO_GRID_LEVEL on, two levels in one
//                    read: x, y grandchildren by Morton code (a leaf's eight if the children are
//                    leaves); z first child; w first grandchild
//     ASVO_CONE(i)   what a cone reads of voxel i, see asvoConeWords
//
// Where not all of the tree is at hand (src/grays/page_table.h) it defines as well
//
//     ASVO_RESIDENT(i)   whether voxel i, its brick or leaf and what cones read of it are
//                        there; notes that a cone asked. The voxels of the grid always are
//     ASVO_CONE_FINE(i)  ASVO_CONE below the grid, of voxels that are there
//
// Positions and directions are in render space (metres); directions have unit length; everything is
// finite but tmax. No recursion, no 64-bit integers, no subgroup operations; every loop is bounded.
//
// Traversal. The ray is moved to a grid of sub-voxels (4 a leaf edge) and mirrored so that it
// travels towards +x, +y, +z. Its place is an integer cell, moved through one face at a time; so
// its cells form a 6-connected path whatever the rounding, and no closed surface of the masks lets
// it through. Where a place is empty, so is a cube ahead of it, and the ray leaves that in one
// step.
#ifndef ASVO_TRACE_H
#define ASVO_TRACE_H

#ifdef __cplusplus
#define ASVO_OUT(T) T&
#define ASVO_INOUT(T) T&
#define ASVO_READS const
#else
#define ASVO_OUT(T) out T
#define ASVO_INOUT(T) inout T
#define ASVO_READS
#define bitWidth(x) uint(findMSB(x) + 1)
#endif

/// Where a narrow ray met a leaf.
struct AsvoHit {
  float t;      // metres
  uint voxel;   // node index of the leaf
  uint sub;     // number of the sub-voxel, x + 4y + 16z
  vec3 normal;  // unit, of the voxel, facing the ray
};

/// What a cone gathered.
struct AsvoCone {
  vec3 radiance;        // W/(m^2 sr), front to back, weighted by what was visible
  float transmittance;  // of what lies behind, [0, 1]; -1: the cone met voxels that do not know
                        // what they send out, and has no answer
};

/// A ray on the mirrored grid of sub-voxels, moved to where it starts.
struct AsvoRay {
  vec3 o, d, inv;  // origin in [0, N]; direction > 0; 1 / d
  vec3 turn;       // -1 on mirrored axes, else 1
  float base;      // from the given origin to o, in sub-voxels
  float end;       // from o to the end of the ray, in sub-voxels
  ivec3 flip;      // N - 1 on mirrored axes, else 0: true cell = cell ^ flip
  uint octFlip;    // the same for the number of an octant
  uint subFlip;    // the same for the number of a sub-voxel
};

/// What a ray finds at a cell: a voxel, or nothing in a cube of blocks.
struct AsvoPlace {
  uint voxel;  // ASVO_NONE where it is empty
  uint shift;  // the block's edge is 1 << shift sub-voxels
  int blocks;  // edge of the empty cube, in blocks, from this one ahead
};

// A plane stands for geometry within a quarter of a sub-voxel; the rest is for rounding.
ASVO_CONST float kAsvoPlaneTolerance = 0.3125f;
// Unit of the plane offsets of voxels above the leaves, and how near a ray must come, in edges:
// half a unit, and the bend of the surface.
ASVO_CONST float kAsvoPlaneStep = 0.06f;
ASVO_CONST float kAsvoCoarseTolerance = 0.13f;
// Surfaces without a plane mostly lie across several voxels; what each covers adds to more than 1.
ASVO_CONST float kAsvoCoverageGain = 1.25f;
// The coarsest level that cones read: beyond it, a voxel is no smaller than a room.
ASVO_CONST uint kAsvoMinLevel = 3u;
// Coverage that a coarse voxel is held to have at most: 1 would stop rays that graze it.
ASVO_CONST float kAsvoMaxCoverage = 0.996f;
ASVO_CONST float kAsvoMinTransmittance = 0.01f;
// Levels that a cone goes down where a voxel is uneven: what edges and corners of rooms send out
// depends on which of their faces is seen, and a mean of them is dark by 1 to 2 %.
ASVO_CONST uint kAsvoFiner = 2u;
// Coverage from which on a voxel may count as uneven, in 1/63.
ASVO_CONST uint kAsvoLeastUneven = 22u;
// Share of a cone from which on it does not pass over voxels that do not know their light.
ASVO_CONST float kAsvoLeastUnknown = 0.05f;
ASVO_CONST float kAsvoInvPi = 0.318309886f;

#include "asvo/asvo_voxel.h"

// --- Traversal ----------------------------------------------------------------------------------

float asvoMin3(vec3 v) ASVO_READS { return min(v.x, min(v.y, v.z)); }
float asvoMax3(vec3 v) ASVO_READS { return max(v.x, max(v.y, v.z)); }

/// The cell that holds p, held to [lower, upper]; NaN gives lower.
ivec3 asvoCell(vec3 p, ivec3 lower, ivec3 upper) ASVO_READS {
  return ivec3(min(max(vec3(lower), p), vec3(upper)));
}

/// Moves a ray to the grid. False if it misses the cube or is empty.
bool asvoClip(vec3 origin, vec3 dir, float tmin, float tmax, ASVO_OUT(AsvoRay) r) ASVO_READS {
  int n = 4 << ASVO_INFO.depth;
  float cells = float(n);
  float scale = cells / ASVO_INFO.size;
  vec3 o = (origin - vec3(ASVO_INFO.lowerX, ASVO_INFO.lowerY, ASVO_INFO.lowerZ)) * scale;
  bool fx = dir.x < 0.0f;
  bool fy = dir.y < 0.0f;
  bool fz = dir.z < 0.0f;
  o = vec3(fx ? cells - o.x : o.x, fy ? cells - o.y : o.y, fz ? cells - o.z : o.z);
  r.d = max(abs(dir), vec3(1e-12f));
  r.inv = vec3(1.0f) / r.d;
  r.turn = vec3(fx ? -1.0f : 1.0f, fy ? -1.0f : 1.0f, fz ? -1.0f : 1.0f);
  r.flip = ivec3(fx ? n - 1 : 0, fy ? n - 1 : 0, fz ? n - 1 : 0);
  r.octFlip = (fx ? 1u : 0u) | (fy ? 2u : 0u) | (fz ? 4u : 0u);
  r.subFlip = (fx ? 3u : 0u) | (fy ? 12u : 0u) | (fz ? 48u : 0u);
  float enter = max(asvoMax3((vec3(0.0f) - o) * r.inv), tmin * scale);
  float leave = min(asvoMin3((vec3(cells) - o) * r.inv), min(tmax, 1e30f / scale) * scale);
  r.base = enter;
  r.end = leave - enter;
  r.o = min(max(vec3(0.0f), o + r.d * enter), vec3(cells));
  return enter <= leave;
}

/// Number of the octant, in the bits at `shift`, that holds the cell.
uint asvoOctant(ivec3 cell, uint shift) ASVO_READS {
  ivec3 bit = (cell >> ivec3(shift)) & ivec3(1);
  return uint(bit.x | (bit.y << 1) | (bit.z << 2));
}

#ifdef ASVO_GRID

/// Of the cell (not mirrored), in the table of a level.
uint asvoGridEntry(ivec3 cell, uint level) ASVO_READS {
  ivec3 at = cell >> ivec3(ASVO_INFO.depth + 2u - level);
  return ASVO_GRID(uint((1 << (3u * level)) + at.x + (at.y << level) + (at.z << (2u * level))));
}

/// What an entry of a level says. `way`: the octant of the ray's direction.
AsvoPlace asvoEntryPlace(uint entry, uint way, uint level) ASVO_READS {
  AsvoPlace place;
  place.shift = ASVO_INFO.depth + 2u - level;
  bool empty = entry >= ASVO_GRID_EMPTY;
  place.voxel = empty ? ASVO_NONE : entry & (ASVO_GRID_UNEVEN - 1u);
  place.blocks = empty ? int((entry >> (3u * way)) & 7u) + 1 : 1;
  return place;
}

/// What is at the cell, by the table of a level; not below it.
AsvoPlace asvoGridPlace(ivec3 cell, uint way, uint level) ASVO_READS {
  return asvoEntryPlace(asvoGridEntry(cell, level), way, level);
}

/// What a cone finds there: where it is uneven, two levels finer.
AsvoPlace asvoConeGridPlace(ivec3 cell, uint way, uint level) ASVO_READS {
  uint entry = asvoGridEntry(cell, level);
  if ((entry & (ASVO_GRID_EMPTY | ASVO_GRID_UNEVEN)) == ASVO_GRID_UNEVEN) {
    level = min(level + kAsvoFiner, ASVO_GRID_LEVEL);
    entry = asvoGridEntry(cell, level);
  }
  return asvoEntryPlace(entry, way, level);
}

/// From a voxel a level or two down, towards the cell, but not below `stop`. Two reads of a tree in
/// one.
AsvoPlace asvoDescend(AsvoPlace place, ivec3 cell, uint stop) ASVO_READS {
  uvec4 brick = ASVO_BRICK(place.voxel);
  uint high = asvoOctant(cell, place.shift - 1u);
  uint eight = ((high < 4u ? brick.x : brick.y) >> (8u * (high & 3u))) & 255u;
  if (eight == 0u) {
    place.shift -= 1u;
    place.voxel = ASVO_NONE;
  } else if (place.shift == stop + 1u) {
    // One bit of each byte that is not empty: the children.
    uvec2 any = uvec2(brick.x, brick.y);
    any |= any >> uvec2(4u);
    any |= any >> uvec2(2u);
    any |= any >> uvec2(1u);
    any &= uvec2(0x01010101u);
    uint below = (1u << (8u * (high & 3u))) - 1u;
    place.voxel = brick.z + uint(high < 4u ? bitCount(any.x & below)
                                           : bitCount(any.x) + bitCount(any.y & below));
    place.shift -= 1u;
  } else {
    uint low = asvoOctant(cell, place.shift - 2u);
    uint below = (1u << (8u * (high & 3u) + low)) - 1u;
    uint rank =
        uint(high < 4u ? bitCount(brick.x & below) : bitCount(brick.x) + bitCount(brick.y & below));
    place.voxel = ((eight >> low) & 1u) != 0u ? brick.w + rank : ASVO_NONE;
    place.shift -= 2u;
  }
  return place;
}

/// The voxel of size 1 << stop that holds the cell, or what is empty around it.
AsvoPlace asvoPlace(ivec3 cell, uint way, uint stop) ASVO_READS {
  AsvoPlace place = asvoGridPlace(cell, way, min(ASVO_INFO.depth + 2u - stop, ASVO_GRID_LEVEL));
  while (place.voxel != ASVO_NONE && place.shift > stop) {
    place = asvoDescend(place, cell, stop);
  }
  return place;
}

#ifdef ASVO_RESIDENT

/// What a cone finds: where a voxel is missing, the next coarser one that is there.
AsvoPlace asvoConePlace(ivec3 cell, uint way, uint stop) ASVO_READS {
  AsvoPlace place = asvoGridPlace(cell, way, min(ASVO_INFO.depth + 2u - stop, ASVO_GRID_LEVEL));
  uint aim = stop;
  while (place.voxel != ASVO_NONE && place.shift > aim) {
    AsvoPlace next = asvoDescend(place, cell, aim);
    bool there = next.voxel == ASVO_NONE || ASVO_RESIDENT(next.voxel);
    // Of two levels down, the one between may be there.
    aim = there ? aim : next.shift + 1u;
    if (there) place = next;
  }
  return place;
}

#else

/// What a cone finds.
AsvoPlace asvoConePlace(ivec3 cell, uint way, uint stop) ASVO_READS {
  return asvoPlace(cell, way, stop);
}

#endif

#else

/// The voxel of size 1 << stop that holds the cell (not mirrored), or the largest empty block
/// around it.
AsvoPlace asvoPlace(ivec3 cell, uint /*way*/, uint stop) ASVO_READS {
  AsvoPlace place;
  place.voxel = 0u;
  place.shift = ASVO_INFO.depth + 2u;
  place.blocks = 1;
  while (place.shift > stop && place.voxel != ASVO_NONE) {
    uvec2 node = ASVO_NODE(place.voxel);
    place.shift -= 1u;
    uint octant = asvoOctant(cell, place.shift);
    bool there = ((node.y >> octant) & 1u) != 0u;
    place.voxel = there ? node.x + uint(bitCount(node.y & ((1u << octant) - 1u))) : ASVO_NONE;
  }
  return place;
}

/// Edge of the cube of empty places of a level from this one in the direction of an octant, at most
/// 8; by asking for each of them.
int asvoEmptyCube(ivec3 at, uint level, uint way) ASVO_READS {
  ivec3 signs =
      ivec3((way & 1u) != 0u ? -1 : 1, (way & 2u) != 0u ? -1 : 1, (way & 4u) != 0u ? -1 : 1);
  int cells = 1 << level;
  uint shift = ASVO_INFO.depth + 2u - level;
  for (int edge = 1; edge < 8; ++edge) {
    int wide = edge + 1;
    for (int i = 0; i < wide * wide * wide; ++i) {
      ivec3 far = ivec3(i % wide, i / wide % wide, i / (wide * wide));
      ivec3 p = at + signs * far;
      bool shell = far.x == edge || far.y == edge || far.z == edge;
      bool inside = p.x >= 0 && p.y >= 0 && p.z >= 0 && p.x < cells && p.y < cells && p.z < cells;
      if (shell && inside && asvoPlace(p << ivec3(shift), way, shift).voxel != ASVO_NONE) {
        return edge;
      }
    }
  }
  return 8;
}

/// What a cone finds: with the cubes of the tables, so that it takes the same steps.
AsvoPlace asvoConePlace(ivec3 cell, uint way, uint stop) ASVO_READS {
  uint bits = ASVO_INFO.depth + 2u;
  uint finest = min(ASVO_INFO.depth - 1u, ASVO_MAX_GRID_LEVEL);
  uint grid = min(bits - stop, finest);
  AsvoPlace place = asvoPlace(cell, way, stop);
  if (place.voxel != ASVO_NONE && grid < finest && asvoUneven(place.voxel)) {
    grid = min(grid + kAsvoFiner, finest);
    place = asvoPlace(cell, way, bits - grid);
  }
  if (place.voxel == ASVO_NONE && bits - place.shift <= grid) {
    place.shift = bits - grid;
    place.blocks = asvoEmptyCube(cell >> ivec3(place.shift), grid, way);
  }
  return place;
}

#endif

/// Where the ray leaves the cube of blocks; `end`: the cell beyond its far corner.
vec3 asvoExit(AsvoRay r, ivec3 cell, AsvoPlace place, ASVO_OUT(ivec3) end) ASVO_READS {
  end = ((cell >> ivec3(place.shift)) + ivec3(place.blocks)) << ivec3(place.shift);
  return (vec3(end) - r.o) * r.inv;
}

/// The cell behind the cube that ends at `end`, entered at distance t through one face.
ivec3 asvoStep(AsvoRay r, ivec3 cell, ivec3 end, vec3 texit, float t) ASVO_READS {
  ivec3 next = asvoCell(r.o + r.d * t, cell, end - ivec3(1));
  bool x = texit.x <= texit.y && texit.x <= texit.z;
  bool y = !x && texit.y <= texit.z;
  next.x = x ? end.x : next.x;
  next.y = y ? end.y : next.y;
  next.z = x || y ? next.z : end.z;
  return next;
}

bool asvoOutside(ivec3 cell) ASVO_READS {
  return ((cell.x | cell.y | cell.z) >> (ASVO_INFO.depth + 2u)) != 0;
}

/// Traverses the sub-voxels of one leaf from `start` on, where the ray is at distance t. `plane`:
/// its byte, with the normal `n` (mirrored). At a hit: its distance and the sub-voxel.
bool asvoLeafHit(AsvoRay r, ivec3 start, float tstart, uvec2 mask, uint plane, vec3 n,
                 ASVO_OUT(float) thit, ASVO_OUT(uint) sub) ASVO_READS {
  ivec3 cell = start;
  float t = tstart;
  bool planar = plane != 0u;
  // Distance from the plane along the ray: height + slope * t, in sub-voxels.
  vec3 centre = vec3(cell & ivec3(~3)) + vec3(2.0f);
  float offset = (float(int(plane)) - 128.0f) * (4.0f * ASVO_PLANE_STEP);
  float height = dot(n, r.o - centre) - offset;
  float slope = dot(n, r.d);
  thit = t;
  sub = 0u;
  for (int i = 0; i < 10; ++i) {
    vec3 texit = (vec3(cell + ivec3(1)) - r.o) * r.inv;
    float tnext = max(t, asvoMin3(texit));
    uint bit = uint((cell.x & 3) | ((cell.y & 3) << 2) | ((cell.z & 3) << 4)) ^ r.subFlip;
    if ((((bit < 32u ? mask.x : mask.y) >> (bit & 31u)) & 1u) != 0u) {
      float h0 = height + slope * t;
      float h1 = height + slope * tnext;
      if (!planar || h0 * h1 <= 0.0f || min(abs(h0), abs(h1)) <= kAsvoPlaneTolerance) {
        float part = h0 * h1 < 0.0f ? h0 / (h0 - h1) : (abs(h1) < abs(h0) ? 1.0f : 0.0f);
        thit = t + (tnext - t) * (planar ? part : 0.0f);
        sub = bit;
        return true;
      }
    }
    t = tnext;
    if (texit.x <= texit.y && texit.x <= texit.z) {
      cell.x += 1;
    } else if (texit.y <= texit.z) {
      cell.y += 1;
    } else {
      cell.z += 1;
    }
    ivec3 moved = cell ^ start;
    if ((moved.x | moved.y | moved.z) > 3) {
      return false;
    }
  }
  return false;
}

/// Narrow ray: the first occupied sub-voxel in [tmin, tmax]. In a leaf with a plane the ray must
/// meet the plane inside an occupied sub-voxel (within kAsvoPlaneTolerance sub-voxels); else the
/// hit is where the ray enters the sub-voxel. A ray that starts in an occupied sub-voxel may hit at
/// once.
bool asvoIntersect(vec3 origin, vec3 dir, float tmin, float tmax,
                   ASVO_OUT(AsvoHit) hit) ASVO_READS {
  hit.t = tmax;
  hit.voxel = ASVO_NONE;
  hit.sub = 0u;
  hit.normal = -dir;
  AsvoRay r;
  if (!asvoClip(origin, dir, tmin, tmax, r)) {
    return false;
  }
  uint bits = ASVO_INFO.depth + 2u;
  ivec3 cell = asvoCell(r.o, ivec3(0), ivec3((1 << bits) - 1));
  float t = 0.0f;
  uint limit = (3u << ASVO_INFO.depth) + 4u;
  for (uint i = 0u; i < limit; ++i) {
    AsvoPlace place = asvoPlace(cell ^ r.flip, r.octFlip, 2u);
    if (place.voxel != ASVO_NONE) {
      float thit;
      uint sub;
      uvec2 mask = ASVO_LEAF(place.voxel - ASVO_INFO.firstLeaf);
      uvec4 v = ASVO_VOXEL(place.voxel);
      vec3 n = asvoUnpackNormal(v.y);
      if (asvoLeafHit(r, cell, t, mask, v.z >> 24, n * r.turn, thit, sub)) {
        if (thit > r.end) {
          return false;
        }
        hit.t = (r.base + thit) * (ASVO_INFO.size / float(1u << bits));
        hit.t = min(max(tmin, hit.t), tmax);
        hit.voxel = place.voxel;
        hit.sub = sub;
        hit.normal = dot(n, dir) > 0.0f ? -n : n;
        return true;
      }
    }
    ivec3 end;
    vec3 texit = asvoExit(r, cell, place, end);
    t = max(t, asvoMin3(texit));
    cell = asvoStep(r, cell, end, texit, t);
    if (t >= r.end || asvoOutside(cell)) {
      return false;
    }
  }
  return false;
}

// --- Cones --------------------------------------------------------------------------------------

/// The state of a cone on its way.
struct AsvoMarch {
  ivec3 cell;
  float t;
  vec3 radiance;
  float transmittance;
  bool done;
};

/// Opacity of a voxel above the leaves for the ray between t0 and t1. With a plane: how much of it
/// is covered, if the ray meets it; so flat walls block however they are turned, and a ray that
/// leaves a wall is not blocked by it. Else each axis blocks by its coverage, of whichever side, in
/// proportion to the way that the ray makes along it: (1 - c)^(way / edge). `n`: normal, mirrored;
/// `slope`: along the ray.
float asvoOpacity(AsvoRay r, uint shape, vec3 n, float slope, ivec3 cell, uint shift, float t0,
                  float t1) ASVO_READS {
  float inverse = uintBitsToFloat((127u - shift) << 23);  // of the edge
  float way = (t1 - t0) * inverse;
  uint plane = shape >> 24;
  vec3 corner = vec3((cell >> ivec3(shift)) << ivec3(shift));
  vec3 entry = (r.o + r.d * t0 - corner) * inverse - vec3(0.5f);
  float h0 = dot(n, entry) - (float(int(plane & 31u)) - 16.0f) * kAsvoPlaneStep;
  float h1 = h0 + slope * way;
  bool meets = h0 * h1 <= 0.0f || min(abs(h0), abs(h1)) <= kAsvoCoarseTolerance;
  float sheet = meets ? float(int((plane >> 5) + 1u)) * 0.125f : 0.0f;
  vec3 extinction = vec3(ivec3(uvec3(shape & 255u, (shape >> 8) & 255u, (shape >> 16) & 255u)));
  float rough = 1.0f - exp2(dot(extinction, r.d) * way * (-8.0f / 255.0f));
  return (plane & 31u) != 0u ? sheet : rough;
}

/// Level to read, as levels above the leaves: the width of the cone in leaf voxels, its power of
/// two taken from the exponent.
uint asvoConeLevel(float width) ASVO_READS {
  uint coarsest = ASVO_INFO.depth - min(ASVO_INFO.depth, kAsvoMinLevel);
  return min((floatBitsToUint(min(max(1.0f, width), 4096.0f)) >> 23) - 127u, coarsest);
}

/// Takes what a voxel sends and hides, up to the distance `until`. `fine`: it may lie below the
/// grid and be a leaf.
void asvoConeTake(AsvoRay r, AsvoPlace place, float until, bool fine, bool lit,
                  ASVO_INOUT(AsvoMarch) m) ASVO_READS {
  // NOLINTNEXTLINE(bugprone-branch-clone): the same where no page may be absent.
  uvec4 words = fine ? ASVO_CONE_FINE(place.voxel) : ASVO_CONE(place.voxel);
  vec3 n = vec3(ivec3(uvec3(words.y & 1023u, (words.y >> 10) & 1023u, (words.y >> 20) & 1023u)));
  n = (n * (1.0f / 511.0f) - vec3(1.0f)) * r.turn;
  float slope = dot(n, r.d);
  float opacity = asvoOpacity(r, words.x, n, slope, m.cell, place.shift, m.t, until);
  if (fine && place.shift == 2u) {
    float thit;
    uint sub;
    uvec2 mask = ASVO_LEAF(place.voxel - ASVO_INFO.firstLeaf);
    bool met = asvoLeafHit(r, m.cell, m.t, mask, words.x >> 24, n, thit, sub) && thit <= r.end;
    opacity = met ? 1.0f : 0.0f;
  }
  bool unknown = lit && words.y >= ASVO_CONE_UNKNOWN;
  if (unknown && m.transmittance * opacity > kAsvoLeastUnknown) {
    m.transmittance = -1.0f;
    return;
  }
  if (lit) {
    m.radiance += (m.transmittance * opacity) * asvoUnpackRgb9e5(slope <= 0.0f ? words.z : words.w);
  }
  m.transmittance *= 1.0f - opacity;
}

/// Goes through a place, taking what is there.
void asvoConeStep(AsvoRay r, AsvoPlace place, bool fine, bool lit,
                  ASVO_INOUT(AsvoMarch) m) ASVO_READS {
  ivec3 end;
  vec3 texit = asvoExit(r, m.cell, place, end);
  float t = max(m.t, asvoMin3(texit));
  if (place.voxel != ASVO_NONE) {
    asvoConeTake(r, place, min(t, r.end), fine, lit, m);
  }
  m.t = t;
  m.cell = asvoStep(r, m.cell, end, texit, t);
  m.done = t >= r.end || m.transmittance < kAsvoMinTransmittance || asvoOutside(m.cell);
}

/// The finest level in the grid, as levels above the leaves; above all levels without a grid.
uint asvoGridShift() ASVO_READS {
#ifdef ASVO_GRID
  return ASVO_INFO.depth - ASVO_GRID_LEVEL;
#else
  return ASVO_MAX_DEPTH + 1u;
#endif
}

/// Whether a cone reads only levels of the grid from its start on.
bool asvoStartsWide(float tanHalf, float tmin, float jitter) ASVO_READS {
  float cells = float(4u << ASVO_INFO.depth) / ASVO_INFO.size;
  return asvoConeLevel(0.5f * tanHalf * exp2(jitter) * tmin * cells) >= asvoGridShift();
}

/// March of a cone; see asvoGather. `lit` false: transmittance alone.
AsvoCone asvoMarch(vec3 origin, vec3 dir, float tanHalf, float tmin, float tmax, float jitter,
                   bool lit) ASVO_READS {
  // The jitter also dithers the level: floor(log2(width) + jitter) is log2(width) on average.
  float widthScale = 0.5f * tanHalf * exp2(jitter);
  AsvoRay r;
  AsvoMarch m;
  m.done = !asvoClip(origin, dir, tmin, tmax, r);
  m.cell = asvoCell(r.o, ivec3(0), ivec3((4 << ASVO_INFO.depth) - 1));
  m.t = 0.0f;
  m.radiance = vec3(0.0f);
  m.transmittance = 1.0f;
  int limit = int(3u << ASVO_INFO.depth) + 4;
  uint coarse = asvoGridShift();
  while (ASVO_FINE && !m.done && limit > 0) {
    uint level = asvoConeLevel(widthScale * (r.base + m.t));
    if (level >= coarse) {
      break;
    }
    asvoConeStep(r, asvoConePlace(m.cell ^ r.flip, r.octFlip, level + 2u), true, lit, m);
    limit -= 1;
  }
#ifdef ASVO_GRID
  // A cone grows: from here on it reads levels of the grid, where a step costs least.
  while (!m.done && limit > 0) {
    uint level = max(coarse, asvoConeLevel(widthScale * (r.base + m.t)));
    AsvoPlace place = asvoConeGridPlace(m.cell ^ r.flip, r.octFlip, ASVO_INFO.depth - level);
    asvoConeStep(r, place, false, lit, m);
    limit -= 1;
  }
#endif
  AsvoCone cone;
  cone.radiance = m.radiance;
  cone.transmittance = m.transmittance;
  return cone;
}

/// Gathers along a cone with apex `origin` and half angle atan(tanHalf), from tmin to tmax.
/// `jitter` in [0, 1) dithers the level that is read (not the start: what stood before it would be
/// missed). Radiance: what voxels send out (asvoConeWords) front to back.
AsvoCone asvoGather(vec3 origin, vec3 dir, float tanHalf, float tmin, float tmax,
                    float jitter) ASVO_READS {
  return asvoMarch(origin, dir, tanHalf, tmin, tmax, jitter, true);
}

/// Transmittance of the same cone.
float asvoTransmittance(vec3 origin, vec3 dir, float tanHalf, float tmin, float tmax,
                        float jitter) ASVO_READS {
  return asvoMarch(origin, dir, tanHalf, tmin, tmax, jitter, false).transmittance;
}

// --- Look-up ------------------------------------------------------------------------------------

/// The voxel of a level (0 root, ASVO_INFO.depth leaves) at a cell of that level; ASVO_NONE if
/// empty.
uint asvoFindCell(uvec3 cell, uint level) ASVO_READS {
  uint shift = ASVO_INFO.depth + 2u - level;
  return asvoPlace(ivec3(cell) << ivec3(shift), 0u, shift).voxel;
}

/// Position in units of voxels of a level, from the corner of the cube.
vec3 asvoGridPosition(vec3 p, uint level) ASVO_READS {
  return (p - vec3(ASVO_INFO.lowerX, ASVO_INFO.lowerY, ASVO_INFO.lowerZ)) *
         (float(1u << level) / ASVO_INFO.size);
}

bool asvoInside(vec3 g, float cells) ASVO_READS {
  return g.x >= 0.0f && g.y >= 0.0f && g.z >= 0.0f && g.x < cells && g.y < cells && g.z < cells;
}

/// The voxel of a level that contains p; ASVO_NONE if that place is empty or outside the cube.
uint asvoFind(vec3 p, uint level) ASVO_READS {
  vec3 g = asvoGridPosition(p, level);
  return asvoInside(g, float(1u << level)) ? asvoFindCell(uvec3(g), level) : ASVO_NONE;
}

/// asvoFind at p; if empty, half a voxel to either side along n; then the 26 neighbours, the
/// nearest (by the distance of p from their boxes) first. ASVO_NONE if all are empty.
uint asvoFindNear(vec3 p, vec3 n, uint level) ASVO_READS {
  uint voxel = asvoFind(p, level);
  if (voxel != ASVO_NONE) {
    return voxel;
  }
  float edge = ASVO_INFO.size / float(1u << level);
  voxel = asvoFind(p - 0.5f * edge * n, level);
  if (voxel != ASVO_NONE) {
    return voxel;
  }
  voxel = asvoFind(p + 0.5f * edge * n, level);
  if (voxel != ASVO_NONE) {
    return voxel;
  }
  float cells = float(1u << level);
  vec3 g = asvoGridPosition(p, level);
  g = min(max(vec3(-2.0f), g), vec3(cells + 2.0f));
  vec3 home = floor(g);
  float nearest = 1e30f;
  for (int i = 0; i < 27; ++i) {
    vec3 offset = vec3(float(i % 3 - 1), float((i / 3) % 3 - 1), float(i / 9 - 1));
    vec3 lower = home + offset;
    vec3 gap = max(max(lower - g, g - lower - vec3(1.0f)), vec3(0.0f));
    float distance2 = dot(gap, gap);
    if (i != 13 && distance2 < nearest && asvoInside(lower, cells)) {
      uint found = asvoFindCell(uvec3(lower), level);
      if (found != ASVO_NONE) {
        voxel = found;
        nearest = distance2;
      }
    }
  }
  return voxel;
}

#endif
