// The ASVO tracer: one text, compiled as GLSL and, through GLM, as C++. [Crassin et al. 2011,
// cones; Laine and Karras 2010, planes in voxels; Amanatides and Woo 1987, grid traversal]
//
// C++:  included inside the body of class Tracer (tracer.h), so the functions are its members.
// GLSL: the shader declares its buffers, defines the accessors, then includes this file:
//
//     ASVO_NODE(i) uvec2    ASVO_VOXEL(i) uvec4, i = 2 * voxel or 2 * voxel + 1
//     ASVO_LEAF(k) uvec4    ASVO_LIGHT(i) uvec4    ASVO_INFO AsvoInfo        (see asvo_layout.h)
//
// Optionally the includer defines ASVO_GRID(i), a table of the levels up to ASVO_GRID_LEVEL (at
// most the depth): entry 8^l + x + 2^l y + 4^l z is the voxel at that place of level l, or, where
// it is empty, ASVO_GRID_EMPTY + the level of the largest empty block around it. Same answers,
// fewer reads: the descent starts from the table instead of the stack described below.
//
// Positions and directions are in render space (metres); directions have unit length; everything is
// finite but tmax. No recursion, no 64-bit integers, no subgroup operations; every loop is bounded.
//
// Traversal. The ray is moved to a grid of sub-voxels (4 a leaf edge) and mirrored so that it
// travels towards +x, +y, +z. Its place is an integer cell, moved through one face at a time; so
// its cells form a 6-connected path whatever the rounding, and no closed surface of the masks lets
// it through. After a step the descent starts at the deepest ancestor common to both cells; the
// nodes on the way from the root are kept in two small arrays.
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
  vec3 normal;  // unit, facing the ray: of the plane, or of the voxel where there is no plane
};

/// What a cone gathered.
struct AsvoCone {
  vec3 radiance;        // W/(m^2 sr), front to back, weighted by what was visible
  float transmittance;  // of what lies behind, [0, 1]
};

/// A ray on the mirrored grid of sub-voxels, moved to where it starts.
struct AsvoRay {
  vec3 o, d, inv;  // origin in [0, N]; direction > 0; 1 / d
  float base;      // from the given origin to o, in sub-voxels
  float end;       // from o to the end of the ray, in sub-voxels
  uvec3 flip;      // N - 1 on mirrored axes, else 0: true cell = cell ^ flip
  uint octFlip;    // the same for the number of an octant
  uint subFlip;    // the same for the number of a sub-voxel
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
ASVO_CONST float kAsvoInvPi = 0.318309886f;

// --- Packed values ------------------------------------------------------------------------------

/// Shared-exponent RGB (EXT_texture_shared_exponent): 9 bits each, exponent 5 bits with bias 15.
vec3 asvoUnpackRgb9e5(uint packed) ASVO_READS {
  float scale = uintBitsToFloat(((packed >> 27) + 103u) << 23);  // 2^(e - 15 - 9)
  return vec3(float(packed & 511u), float((packed >> 9) & 511u), float((packed >> 18) & 511u)) *
         scale;
}

/// Clamps to [0, 65408]; NaN becomes 0.
uint asvoPackRgb9e5(vec3 v) ASVO_READS {
  float r = v.x > 0.0f ? min(v.x, 65408.0f) : 0.0f;
  float g = v.y > 0.0f ? min(v.y, 65408.0f) : 0.0f;
  float b = v.z > 0.0f ? min(v.z, 65408.0f) : 0.0f;
  float top = max(r, max(g, b));
  // Exponent of the largest component, biased by 15, such that it lies in [2^8, 2^9) after scaling.
  int e = max(int(floatBitsToUint(top) >> 23) - 127, -16) + 16;
  float scale = uintBitsToFloat(uint(127 - (e - 24)) << 23);
  if (top * scale + 0.5f >= 512.0f) {
    e += 1;
    scale *= 0.5f;
  }
  return uint(r * scale + 0.5f) | (uint(g * scale + 0.5f) << 9) | (uint(b * scale + 0.5f) << 18) |
         (uint(e) << 27);
}

/// Octahedral unit vector, 2 x unorm16 [Cigolle et al., JCGT 2014].
vec3 asvoOctDecode(uint packed) ASVO_READS {
  float x = float(packed & 65535u) * (2.0f / 65535.0f) - 1.0f;
  float y = float(packed >> 16) * (2.0f / 65535.0f) - 1.0f;
  float z = 1.0f - abs(x) - abs(y);
  float fold = max(-z, 0.0f);
  return normalize(vec3(x + (x >= 0.0f ? -fold : fold), y + (y >= 0.0f ? -fold : fold), z));
}

uint asvoOctEncode(vec3 n) ASVO_READS {
  float s = 1.0f / max(abs(n.x) + abs(n.y) + abs(n.z), 1e-30f);
  float x = n.x * s;
  float y = n.y * s;
  if (n.z < 0.0f) {
    float fx = (1.0f - abs(y)) * (x >= 0.0f ? 1.0f : -1.0f);
    float fy = (1.0f - abs(x)) * (y >= 0.0f ? 1.0f : -1.0f);
    x = fx;
    y = fy;
  }
  uint px = uint(min(max(0.0f, x * 0.5f + 0.5f), 1.0f) * 65535.0f + 0.5f);
  uint py = uint(min(max(0.0f, y * 0.5f + 0.5f), 1.0f) * 65535.0f + 0.5f);
  return px | (py << 16);
}

vec3 asvoUnpackAlbedo(uint packed) ASVO_READS {
  return vec3(float(packed & 255u), float((packed >> 8) & 255u), float((packed >> 16) & 255u)) *
         (1.0f / 255.0f);
}

// --- Voxels -------------------------------------------------------------------------------------

/// Diffuse albedo, linear, [0, 1].
vec3 asvoAlbedo(uint voxel) ASVO_READS { return asvoUnpackAlbedo(ASVO_VOXEL(2u * voxel).z); }

/// Unit normal; its side is the front.
vec3 asvoNormal(uint voxel) ASVO_READS { return asvoOctDecode(ASVO_VOXEL(2u * voxel).w); }

/// The material with the largest area in the voxel.
uint asvoMaterial(uint voxel) ASVO_READS { return ASVO_VOXEL(2u * voxel).y >> 16; }

/// Triangle area of a side, m^2.
float asvoArea(uint voxel, bool front) ASVO_READS {
  uvec4 v = ASVO_VOXEL(2u * voxel + 1u);
  return uintBitsToFloat(front ? v.z : v.w);
}

/// Emitted radiance of a side.
vec3 asvoEmission(uint voxel, bool front) ASVO_READS {
  uvec4 v = ASVO_VOXEL(2u * voxel + 1u);
  return asvoUnpackRgb9e5(front ? v.x : v.y);
}

/// Whether the front of a child is part of the back of its parent: sums over sides that go up the
/// tree exchange the sides then.
bool asvoFlips(uint child, uint parent) ASVO_READS {
  return dot(asvoNormal(child), asvoNormal(parent)) < 0.0f;
}

/// Cached radiance that leaves the voxel against dir: albedo / pi * irradiance of the side that
/// faces the ray. Without emission.
vec3 asvoOutgoing(uint voxel, vec3 dir) ASVO_READS {
  uvec4 v = ASVO_VOXEL(2u * voxel);
  uvec4 light = ASVO_LIGHT(voxel);
  bool front = dot(asvoOctDecode(v.w), dir) <= 0.0f;
  return asvoUnpackAlbedo(v.z) * asvoUnpackRgb9e5(front ? light.x : light.y) * kAsvoInvPi;
}

// --- Traversal ----------------------------------------------------------------------------------

float asvoMin3(vec3 v) ASVO_READS { return min(v.x, min(v.y, v.z)); }
float asvoMax3(vec3 v) ASVO_READS { return max(v.x, max(v.y, v.z)); }

/// The cell that holds p, held to [lower, upper]; NaN gives lower.
uvec3 asvoCell(vec3 p, uvec3 lower, uvec3 upper) ASVO_READS {
  return uvec3(min(max(vec3(lower), p), vec3(upper)));
}

/// Moves a ray to the grid. False if it misses the cube or is empty.
bool asvoClip(vec3 origin, vec3 dir, float tmin, float tmax, ASVO_OUT(AsvoRay) r) ASVO_READS {
  uint n = 4u << ASVO_INFO.depth;
  float cells = float(n);
  float scale = cells / ASVO_INFO.size;
  vec3 o = (origin - vec3(ASVO_INFO.lowerX, ASVO_INFO.lowerY, ASVO_INFO.lowerZ)) * scale;
  bool fx = dir.x < 0.0f;
  bool fy = dir.y < 0.0f;
  bool fz = dir.z < 0.0f;
  o = vec3(fx ? cells - o.x : o.x, fy ? cells - o.y : o.y, fz ? cells - o.z : o.z);
  r.d = max(abs(dir), vec3(1e-12f));
  r.inv = vec3(1.0f) / r.d;
  r.flip = uvec3(fx ? n - 1u : 0u, fy ? n - 1u : 0u, fz ? n - 1u : 0u);
  r.octFlip = (fx ? 1u : 0u) | (fy ? 2u : 0u) | (fz ? 4u : 0u);
  r.subFlip = (fx ? 3u : 0u) | (fy ? 12u : 0u) | (fz ? 48u : 0u);
  float enter = max(asvoMax3((vec3(0.0f) - o) * r.inv), tmin * scale);
  float leave = min(asvoMin3((vec3(cells) - o) * r.inv), min(tmax, 1e30f / scale) * scale);
  r.base = enter;
  r.end = leave - enter;
  r.o = min(max(vec3(0.0f), o + r.d * enter), vec3(cells));
  return enter <= leave;
}

/// Number of the octant, in the bits at `shift`, that holds the cell; not mirrored.
uint asvoOctant(AsvoRay r, uvec3 cell, uint shift) ASVO_READS {
  return (((cell.x >> shift) & 1u) | (((cell.y >> shift) & 1u) << 1) |
          (((cell.z >> shift) & 1u) << 2)) ^
         r.octFlip;
}

/// The cell behind the block of `extent` cells (a power of two) that holds `cell`; t becomes the
/// distance where the ray leaves the block. Through one face, on the other axes within the block.
uvec3 asvoStep(AsvoRay r, uvec3 cell, uint extent, vec3 texit, float t) ASVO_READS {
  uvec3 last = cell | uvec3(extent - 1u);
  uvec3 next = asvoCell(r.o + r.d * t, cell, last);
  if (texit.x <= texit.y && texit.x <= texit.z) {
    next.x = last.x + 1u;
  } else if (texit.y <= texit.z) {
    next.y = last.y + 1u;
  } else {
    next.z = last.z + 1u;
  }
  return next;
}

#ifdef ASVO_GRID
/// The voxel of size 1 << stop that holds the cell, and stop as `shift`; or, where it is empty,
/// ASVO_NONE and the size of the largest empty block. Starts from the grid of the upper levels.
uint asvoDescend(AsvoRay r, uvec3 cell, uint stop, ASVO_OUT(uint) shift) ASVO_READS {
  uint bits = ASVO_INFO.depth + 2u;
  uint level = min(bits - stop, ASVO_GRID_LEVEL);
  uvec3 place = (cell ^ r.flip) >> (bits - level);
  uint child =
      ASVO_GRID((1u << (3u * level)) + place.x + (place.y << level) + (place.z << (2u * level)));
  if (child >= ASVO_GRID_EMPTY) {
    shift = bits - (child - ASVO_GRID_EMPTY);
    return ASVO_NONE;
  }
  shift = bits - level;
  while (shift > stop) {
    uvec2 node = ASVO_NODE(child);
    shift -= 1u;
    uint octant = asvoOctant(r, cell, shift);
    if (((node.y >> octant) & 1u) == 0u) {
      return ASVO_NONE;
    }
    child = node.x + uint(bitCount(node.y & ((1u << octant) - 1u)));
  }
  return child;
}
#endif

/// Traverses the sub-voxels of one leaf from `start` on, where the ray is at distance t. At a hit:
/// its distance, the sub-voxel and the plane normal (zero if the leaf has no plane; not mirrored).
bool asvoLeafHit(AsvoRay r, uvec3 start, float tstart, uvec4 leaf, ASVO_OUT(float) thit,
                 ASVO_OUT(uint) sub, ASVO_OUT(vec3) normal) ASVO_READS {
  uvec3 cell = start;
  float t = tstart;
  bool planar = leaf.w != ASVO_NO_PLANE;
  vec3 n = planar ? asvoOctDecode(leaf.z) : vec3(0.0f);
  normal = n;
  n = vec3(r.flip.x != 0u ? -n.x : n.x, r.flip.y != 0u ? -n.y : n.y, r.flip.z != 0u ? -n.z : n.z);
  // Distance from the plane along the ray: height + slope * t, in sub-voxels.
  vec3 centre = vec3(cell & uvec3(~3u)) + vec3(2.0f);
  float height = planar ? dot(n, r.o - centre) - 4.0f * uintBitsToFloat(leaf.w) : 0.0f;
  float slope = dot(n, r.d);
  thit = t;
  sub = 0u;
  for (int i = 0; i < 10; ++i) {
    vec3 texit = (vec3(cell + uvec3(1u)) - r.o) * r.inv;
    float tnext = max(t, asvoMin3(texit));
    uint bit = ((cell.x & 3u) | ((cell.y & 3u) << 2) | ((cell.z & 3u) << 4)) ^ r.subFlip;
    if ((((bit < 32u ? leaf.x : leaf.y) >> (bit & 31u)) & 1u) != 0u) {
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
      cell.x += 1u;
    } else if (texit.y <= texit.z) {
      cell.y += 1u;
    } else {
      cell.z += 1u;
    }
    uvec3 moved = cell ^ start;
    if ((moved.x | moved.y | moved.z) > 3u) {
      return false;
    }
  }
  return false;
}

/// Opacity of a voxel above the leaves, with lower corner `corner` and edge `edge` in sub-voxels,
/// for the ray between t0 and t1. With a plane: how much of it is covered, if the ray meets it; so
/// flat walls block however they are turned, and a ray that leaves a wall is not blocked by it.
/// Else each axis blocks by its coverage, of whichever side, in proportion to the way that the ray
/// makes along it: (1 - c)^(way / edge).
float asvoOpacity(AsvoRay r, uvec4 voxel, vec3 corner, float edge, float t0, float t1) ASVO_READS {
  uint plane = voxel.z >> 24;
  if ((plane & 31u) != 0u) {
    vec3 n = asvoOctDecode(voxel.w);
    n = vec3(r.flip.x != 0u ? -n.x : n.x, r.flip.y != 0u ? -n.y : n.y, r.flip.z != 0u ? -n.z : n.z);
    float offset = (float(plane & 31u) - 16.0f) * kAsvoPlaneStep + dot(n, vec3(0.5f));
    float h0 = dot(n, r.o + r.d * t0 - corner) - offset * edge;
    float h1 = h0 + dot(n, r.d) * (t1 - t0);
    bool meets = h0 * h1 <= 0.0f || min(abs(h0), abs(h1)) <= kAsvoCoarseTolerance * edge;
    return meets ? float((plane >> 5) + 1u) * 0.125f : 0.0f;
  }
  vec3 coverage = vec3(float(max(voxel.x & 255u, (voxel.x >> 8) & 255u)),
                       float(max((voxel.x >> 16) & 255u, voxel.x >> 24)),
                       float(max(voxel.y & 255u, (voxel.y >> 8) & 255u))) *
                  (kAsvoCoverageGain / 255.0f);
  vec3 clear = vec3(1.0f) - min(coverage, vec3(kAsvoMaxCoverage));
  return 1.0f - exp2(dot(log2(clear), r.d) * ((t1 - t0) / edge));
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
  uint depth = ASVO_INFO.depth;
  uint bits = depth + 2u;
  uvec3 cell = asvoCell(r.o, uvec3(0u), uvec3((1u << bits) - 1u));
#ifndef ASVO_GRID
  uint firsts[ASVO_MAX_DEPTH + 1u];
  uint masks[ASVO_MAX_DEPTH + 1u];
  uvec2 node = ASVO_NODE(0u);
  firsts[0] = node.x;
  masks[0] = node.y;
  uint level = 0u;
#endif
  float t = 0.0f;
  uint limit = (3u << depth) + 4u;
  for (uint i = 0u; i < limit; ++i) {
#ifdef ASVO_GRID
    uint shift;
    uint child = asvoDescend(r, cell, 2u, shift);
#else
    uint child = ASVO_NONE;
    uint shift = bits - 1u - level;
    for (int j = 0; j < 13; ++j) {
      uint octant = asvoOctant(r, cell, shift);
      if (((node.y >> octant) & 1u) == 0u) {
        child = ASVO_NONE;
        break;
      }
      child = node.x + uint(bitCount(node.y & ((1u << octant) - 1u)));
      if (shift == 2u) {
        break;
      }
      node = ASVO_NODE(child);
      level += 1u;
      shift -= 1u;
      firsts[level] = node.x;
      masks[level] = node.y;
    }
#endif
    if (child != ASVO_NONE) {
      float thit;
      uint sub;
      vec3 normal;
      uvec4 leaf = ASVO_LEAF(child - ASVO_INFO.firstLeaf);
      if (asvoLeafHit(r, cell, t, leaf, thit, sub, normal)) {
        if (thit > r.end) {
          return false;
        }
        hit.t = (r.base + thit) * (ASVO_INFO.size / float(1u << bits));
        hit.t = min(max(tmin, hit.t), tmax);
        hit.voxel = child;
        hit.sub = sub;
        normal = dot(normal, normal) > 0.5f ? normal : asvoNormal(child);
        hit.normal = dot(normal, dir) > 0.0f ? -normal : normal;
        return true;
      }
    }
    vec3 texit = (vec3((cell | uvec3((1u << shift) - 1u)) + uvec3(1u)) - r.o) * r.inv;
    t = max(t, asvoMin3(texit));
    uvec3 next = asvoStep(r, cell, 1u << shift, texit, t);
    uvec3 moved = cell ^ next;
    uint width = bitWidth(moved.x | moved.y | moved.z);
    if (t >= r.end || width > bits) {
      return false;
    }
    cell = next;
#ifndef ASVO_GRID
    level = min(level, bits - width);
    node = uvec2(firsts[level], masks[level]);
#endif
  }
  return false;
}

/// March of a cone; see asvoGather. `lit` false: transmittance alone.
AsvoCone asvoMarch(vec3 origin, vec3 dir, float tanHalf, float tmin, float tmax, float jitter,
                   bool lit) ASVO_READS {
  AsvoCone cone;
  cone.radiance = vec3(0.0f);
  cone.transmittance = 1.0f;
  uint depth = ASVO_INFO.depth;
  uint bits = depth + 2u;
  float leafEdge = ASVO_INFO.size / float(1u << depth);
  // The jitter also dithers the level: floor(log2(width) + jitter) is log2(width) on average.
  float widthScale = 0.5f * tanHalf * exp2(jitter);
  float start = tmin + 0.5f * jitter * max(leafEdge, 2.0f * tanHalf * tmin);
  AsvoRay r;
  if (!asvoClip(origin, dir, start, tmax, r)) {
    return cone;
  }
  uvec3 cell = asvoCell(r.o, uvec3(0u), uvec3((1u << bits) - 1u));
#ifndef ASVO_GRID
  uint firsts[ASVO_MAX_DEPTH + 1u];
  uint masks[ASVO_MAX_DEPTH + 1u];
  uvec2 node = ASVO_NODE(0u);
  firsts[0] = node.x;
  masks[0] = node.y;
  uint level = 0u;
#endif
  float t = 0.0f;
  uint limit = (3u << depth) + 4u;
  for (uint i = 0u; i < limit; ++i) {
    // Level to read: the width of the cone in leaf voxels, its power of two taken from the
    // exponent.
    float width = min(max(1.0f, widthScale * (r.base + t)), 4096.0f);
    uint coarser = min((floatBitsToUint(width) >> 23) - 127u, depth - min(depth, kAsvoMinLevel));
    uint stop = coarser + 2u;
#ifdef ASVO_GRID
    uint shift;
    uint child = asvoDescend(r, cell, stop, shift);
#else
    level = min(level, depth - coarser - 1u);
    node = uvec2(firsts[level], masks[level]);
    uint child = ASVO_NONE;
    uint shift = bits - 1u - level;
    for (int j = 0; j < 13; ++j) {
      uint octant = asvoOctant(r, cell, shift);
      if (((node.y >> octant) & 1u) == 0u) {
        child = ASVO_NONE;
        break;
      }
      child = node.x + uint(bitCount(node.y & ((1u << octant) - 1u)));
      if (shift == stop) {
        break;
      }
      node = ASVO_NODE(child);
      level += 1u;
      shift -= 1u;
      firsts[level] = node.x;
      masks[level] = node.y;
    }
#endif
    vec3 texit = (vec3((cell | uvec3((1u << shift) - 1u)) + uvec3(1u)) - r.o) * r.inv;
    float tnext = max(t, asvoMin3(texit));
    if (child != ASVO_NONE) {
      float opacity = 0.0f;
      uvec4 v = ASVO_VOXEL(2u * child);
      if (stop == 2u) {
        float thit;
        uint sub;
        vec3 normal;
        if (asvoLeafHit(r, cell, t, ASVO_LEAF(child - ASVO_INFO.firstLeaf), thit, sub, normal)) {
          opacity = thit <= r.end ? 1.0f : 0.0f;
        }
      } else {
        vec3 corner = vec3(cell & uvec3(~((1u << shift) - 1u)));
        opacity = asvoOpacity(r, v, corner, float(1u << shift), t, min(tnext, r.end));
      }
      if (lit && opacity > 0.0f) {
        uvec4 light = ASVO_LIGHT(child);
        bool front = dot(asvoOctDecode(v.w), dir) <= 0.0f;
        cone.radiance += (cone.transmittance * opacity * kAsvoInvPi) * asvoUnpackAlbedo(v.z) *
                         asvoUnpackRgb9e5(front ? light.x : light.y);
      }
      cone.transmittance *= 1.0f - opacity;
      if (cone.transmittance < kAsvoMinTransmittance) {
        return cone;
      }
    }
    t = tnext;
    uvec3 next = asvoStep(r, cell, 1u << shift, texit, t);
    uvec3 moved = cell ^ next;
    uint changed = bitWidth(moved.x | moved.y | moved.z);
    if (t >= r.end || changed > bits) {
      return cone;
    }
    cell = next;
#ifndef ASVO_GRID
    level = min(level, bits - changed);
#endif
  }
  return cone;
}

/// Gathers along a cone with apex `origin` and half angle atan(tanHalf), from tmin to tmax. The
/// start is moved by `jitter` in [0, 1) of half the cone's width there (at least half a leaf); the
/// jitter also dithers the level that is read. Radiance: cached outgoing light (asvoOutgoing) front
/// to back.
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
  uint voxel = 0u;
  for (uint l = level; l > 0u; --l) {
    uint shift = l - 1u;
    uint octant = ((cell.x >> shift) & 1u) | (((cell.y >> shift) & 1u) << 1) |
                  (((cell.z >> shift) & 1u) << 2);
    uvec2 node = ASVO_NODE(voxel);
    if (((node.y >> octant) & 1u) == 0u) {
      return ASVO_NONE;
    }
    voxel = node.x + uint(bitCount(node.y & ((1u << octant) - 1u)));
  }
  return voxel;
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
