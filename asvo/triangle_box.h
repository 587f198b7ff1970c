// Triangle against boxes of a grid: the separating axis tests of [Schwarz and Seidel 2010] written
// as linear functions, so that the eight children of a cell cost a few additions each.
//
// Lengths are in sub-voxels; the grid has its origin at the corner of the cube.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>

#include "asvo/asvo.h"

namespace asvo {

/// Four tests at a time.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

using Double4 = double __attribute__((vector_size(32)));

/// One bit a group of four tests that may still fail inside the present cell.
using GroupMask = std::uint32_t;

/// A bit a lane.
inline std::uint32_t negativeLanes(Int4 v) {
#ifdef __SSE__
  return static_cast<std::uint32_t>(__builtin_ia32_movmskps(reinterpret_cast<Float4>(v)));
#else
  const auto bit = [v](int lane) { return (v[lane] < 0 ? 1u : 0u) << lane; };
  return bit(0) | bit(1) | bit(2) | bit(3);
#endif
}
inline bool anyNegative(Int4 v) { return negativeLanes(v) != 0; }

inline Float4 splat(float x) { return Float4{x, x, x, x}; }

/// Masks of a leaf's sub-voxels from a bit for each x, y or z, or for each two of them.
inline std::uint64_t maskOfX(std::uint64_t bits) { return bits * 0x1111111111111111ull; }
inline std::uint64_t maskOfXY(std::uint64_t bits) { return bits * 0x0001000100010001ull; }
inline std::uint64_t maskOfY(std::uint64_t bits) {
  return maskOfXY(((bits | bits << 3 | bits << 6 | bits << 9) & 0x1111u) * 0xfu);
}
inline std::uint64_t maskOfZ(std::uint64_t bits) {
  return ((bits | bits << 15 | bits << 30 | bits << 45) & 0x0001000100010001ull) * 0xffffu;
}
inline std::uint64_t maskOfXZ(std::uint64_t bits) {
  const std::uint64_t rows =
      (bits & 0xfu) | (bits & 0xf0u) << 12 | (bits & 0xf00u) << 24 | (bits & 0xf000u) << 36;
  return rows * 0x1111u;
}
inline std::uint64_t maskOfYZ(std::uint64_t bits) {
  const std::uint64_t rows =
      (bits & 0xfu) | (bits & 0xf0u) << 12 | (bits & 0xf00u) << 24 | (bits & 0xf000u) << 36;
  return ((rows | rows << 3 | rows << 6 | rows << 9) & 0x1111111111111111ull) * 0xfu;
}

/// A triangle ready to be tested against boxes with lower corner p and edge s. Test i passes if
/// a[i] . p + b0[i] + s * b1[i] >= 0; a box overlaps the triangle if all pass. Normalised, and b0
/// includes the tolerance, so that rounding never loses a box that the triangle touches.
///
/// Group 0: plane (2), bounds on the dominant axis (2). Group 1: bounds on the others. Groups 2..4:
/// three edges in a projection each (and a test that passes). The order puts what stays undecided
/// inside a large triangle into group 0.
struct TriangleBox {
  static constexpr int kGroups = 5;
  static constexpr GroupMask kAllGroups = (1u << kGroups) - 1u;

  Float4 ax[kGroups], ay[kGroups], az[kGroups], b0[kGroups], b1[kGroups];

  /// `normal`: unit, or zero.
  TriangleBox(const glm::dvec3 vertex[3], const glm::dvec3& normal, double tolerance);

  /// Bits of the children (edge `half`) of the cell at p that the triangle overlaps.
  std::uint32_t children(const glm::vec3& p, float half, GroupMask groups) const;
  /// The groups that can still fail for boxes inside the cell at p with edge s.
  GroupMask undecided(const glm::vec3& p, float s, GroupMask groups) const;
  /// Occupancy of the 4x4x4 sub-voxels of the leaf at p, bit x + 4y + 16z.
  std::uint64_t subVoxels(const glm::vec3& p, GroupMask groups) const;

 private:
  int dominant_;  ///< axis along which the normal is longest

  /// The tests of a group for the sub-voxel at p.
  Float4 values(int group, const glm::vec3& p) const {
    return ax[group] * splat(p.x) + ay[group] * splat(p.y) + az[group] * splat(p.z) + b0[group] +
           b1[group];
  }
  std::uint64_t insideBounds(const glm::vec3& p) const;
  std::uint32_t insideEdges(int axis, const glm::vec3& p) const;
  std::uint64_t nearPlane(const glm::vec3& p, std::uint64_t mask) const;
  void set(int test, const glm::dvec3& a, double b);
  void setEdges(const glm::dvec3 vertex[3], const glm::dvec3& normal, double tolerance);
};

/// The octants of a cell with that middle that lower and upper bounds touch; one alone if the
/// bounds lie in one cell of a level below.
inline std::uint32_t octantsOf(const glm::vec3& lower, const glm::vec3& upper,
                               const glm::vec3& middle) {
  constexpr std::uint32_t kUpperHalf[3] = {0xaau, 0xccu, 0xf0u};
  std::uint32_t octants = 0xffu;
  for (int axis = 0; axis < 3; ++axis) {
    if (upper[axis] < middle[axis]) octants &= ~kUpperHalf[axis];
    if (lower[axis] >= middle[axis]) octants &= kUpperHalf[axis];
  }
  return octants;
}

/// a . p + b >= 0 for some point p of a box: the box's largest value of a . p is added through b1.
/// `a`: of unit length.
inline void TriangleBox::set(int test, const glm::dvec3& a, double b) {
  const int group = test / 4, lane = test % 4;
  ax[group][lane] = static_cast<float>(a.x);
  ay[group][lane] = static_cast<float>(a.y);
  az[group][lane] = static_cast<float>(a.z);
  b0[group][lane] = static_cast<float>(b);
  const glm::dvec3 up = glm::max(a, glm::dvec3(0.0));
  b1[group][lane] = static_cast<float>(up.x + up.y + up.z);
}

/// A lane an edge. Directions are rounded to floats first, offsets then follow from these, so that
/// the line goes through the vertex.
inline void TriangleBox::setEdges(const glm::dvec3 vertex[3], const glm::dvec3& normal,
                                  double tolerance) {
  glm::dvec3 edge[3];
  double longest = 0.0;
  for (int e = 0; e < 3; ++e) {
    edge[e] = vertex[(e + 1) % 3] - vertex[e];
    const glm::dvec3 size = glm::abs(edge[e]);
    longest = std::max(longest, std::max(size.x, std::max(size.y, size.z)));
  }
  // Of the longest component, so that squares stay in range.
  const double scale = longest > 0.0 ? 1.0 / longest : 0.0;
  Float4 way[3];
  Double4 start[3];
  for (int axis = 0; axis < 3; ++axis) {
    way[axis] = __builtin_convertvector(
        Double4{edge[0][axis], edge[1][axis], edge[2][axis], 0.0} * scale, Float4);
    start[axis] = Double4{vertex[0][axis], vertex[1][axis], vertex[2][axis], 0.0};
  }
  const Float4 zero = {};
  Float4* const components[3] = {ax, ay, az};
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3, group = 2 + axis;
    const float sign = normal[axis] >= 0.0 ? 1.0f : -1.0f;
    const Float4 square = way[u] * way[u] + way[v] * way[v];
    Float4 length;
    for (int lane = 0; lane < 4; ++lane) length[lane] = std::sqrt(square[lane]);
    const Float4 inverse = square > zero ? sign / length : zero;
    const Float4 nu = -way[v] * inverse, nv = way[u] * inverse;
    const Double4 offset = tolerance - (__builtin_convertvector(nu, Double4) * start[u] +
                                        __builtin_convertvector(nv, Double4) * start[v]);
    components[axis][group] = zero;
    components[u][group] = nu;
    components[v][group] = nv;
    // An edge that is seen end on passes.
    b0[group] = square > zero ? __builtin_convertvector(offset, Float4) : splat(1.0f);
    b1[group] = (nu > zero ? nu : zero) + (nv > zero ? nv : zero);
  }
}

inline TriangleBox::TriangleBox(const glm::dvec3 vertex[3], const glm::dvec3& normal,
                                double tolerance) {
  const glm::dvec3 lower = glm::min(vertex[0], glm::min(vertex[1], vertex[2]));
  const glm::dvec3 upper = glm::max(vertex[0], glm::max(vertex[1], vertex[2]));
  const glm::dvec3 size = glm::abs(normal);
  dominant_ = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
  const double height = glm::dot(normal, vertex[0]);
  set(0, normal, tolerance - height);
  set(1, -normal, tolerance + height);
  for (int i = 0; i < 3; ++i) {
    const int axis = (dominant_ + i) % 3;
    glm::dvec3 a(0.0);
    a[axis] = 1.0;
    set(2 + 2 * i, a, tolerance - lower[axis]);
    set(3 + 2 * i, -a, tolerance + upper[axis]);
  }
  setEdges(vertex, normal, tolerance);
}

inline std::uint32_t TriangleBox::children(const glm::vec3& p, float half, GroupMask groups) const {
  Int4 fail[8] = {};
  for (int g = 0; g < kGroups; ++g) {
    if ((groups >> g & 1u) == 0) continue;
    const Float4 v =
        ax[g] * splat(p.x) + ay[g] * splat(p.y) + az[g] * splat(p.z) + b0[g] + b1[g] * splat(half);
    const Float4 dx = ax[g] * splat(half), dy = ay[g] * splat(half), dz = az[g] * splat(half);
    for (int octant = 0; octant < 8; ++octant) {
      Float4 w = v;
      if (octant & 1) w += dx;
      if (octant & 2) w += dy;
      if (octant & 4) w += dz;
      fail[octant] |= reinterpret_cast<Int4>(w);
    }
  }
  std::uint32_t mask = 0;
  for (int octant = 0; octant < 8; ++octant) {
    mask |= static_cast<std::uint32_t>(!anyNegative(fail[octant])) << octant;
  }
  return mask;
}

inline GroupMask TriangleBox::undecided(const glm::vec3& p, float s, GroupMask groups) const {
  GroupMask left = 0;
  for (int g = 0; g < kGroups; ++g) {
    if ((groups >> g & 1u) == 0) continue;
    // Smallest value over points of the cell: the corner where each component of a counts least.
    const Float4 zero = {};
    const Float4 x = ax[g] * splat(s), y = ay[g] * splat(s), z = az[g] * splat(s);
    const Float4 v = ax[g] * splat(p.x) + ay[g] * splat(p.y) + az[g] * splat(p.z) + b0[g] +
                     (x < zero ? x : zero) + (y < zero ? y : zero) + (z < zero ? z : zero);
    if (anyNegative(reinterpret_cast<Int4>(v))) left |= 1u << g;
  }
  return left;
}

/// Each of these tests looks along one axis.
inline std::uint64_t TriangleBox::insideBounds(const glm::vec3& p) const {
  const Float4 first = values(0, p), second = values(1, p);
  const Float4 step0 = ax[0] + ay[0] + az[0], step1 = ax[1] + ay[1] + az[1];
  std::uint32_t bits[3] = {};
  for (int i = 0; i < 4; ++i) {
    const Float4 along = splat(static_cast<float>(i));
    const std::uint32_t fails0 = negativeLanes(reinterpret_cast<Int4>(first + step0 * along));
    const std::uint32_t fails1 = negativeLanes(reinterpret_cast<Int4>(second + step1 * along));
    bits[dominant_] |= static_cast<std::uint32_t>((fails0 & 12u) == 0) << i;
    bits[(dominant_ + 1) % 3] |= static_cast<std::uint32_t>((fails1 & 3u) == 0) << i;
    bits[(dominant_ + 2) % 3] |= static_cast<std::uint32_t>((fails1 & 12u) == 0) << i;
  }
  return maskOfX(bits[0]) & maskOfY(bits[1]) & maskOfZ(bits[2]);
}

/// The 4x4 columns along an axis that the projected triangle touches, the lower of the two other
/// axes first.
inline std::uint32_t TriangleBox::insideEdges(int axis, const glm::vec3& p) const {
  const Float4* const components[3] = {ax, ay, az};
  const int group = 2 + axis;
  const Float4 column = components[axis == 0 ? 1 : 0][group];
  const Float4 row = components[axis == 2 ? 1 : 2][group];
  const Float4 corner = values(group, p), along = {0.0f, 1.0f, 2.0f, 3.0f};
  Int4 fails[4] = {};
  for (int edge = 0; edge < 3; ++edge) {
    Float4 value = splat(corner[edge]) + splat(column[edge]) * along;
    for (Int4& fail : fails) {
      fail |= reinterpret_cast<Int4>(value);
      value += splat(row[edge]);
    }
  }
  std::uint32_t bits = 0;
  for (int i = 0; i < 4; ++i) bits |= negativeLanes(fails[i]) << (4 * i);
  return ~bits & 0xffffu;
}

/// Those of a mask that the plane touches.
inline std::uint64_t TriangleBox::nearPlane(const glm::vec3& p, std::uint64_t mask) const {
  const Float4 corner = values(0, p), along = {0.0f, 1.0f, 2.0f, 3.0f};
  const Float4 slope = splat(ax[0][0]) * along;
  const Float4 above = splat(corner[0]) + slope, below = splat(corner[1]) - slope;
  std::uint64_t out = 0;
  for (int row = 0; row < 16; ++row) {
    if ((mask >> (4 * row) & 15u) == 0) continue;
    const Float4 height =
        splat(ay[0][0] * static_cast<float>(row % 4) + az[0][0] * static_cast<float>(row / 4));
    const std::uint64_t fails = negativeLanes(reinterpret_cast<Int4>(above + height) |
                                              reinterpret_cast<Int4>(below - height));
    out |= (~fails & 15u) << (4 * row);
  }
  return mask & out;
}

inline std::uint64_t TriangleBox::subVoxels(const glm::vec3& p, GroupMask groups) const {
  std::uint64_t mask = (groups & 3u) != 0 ? insideBounds(p) : ~std::uint64_t{0};
  if (groups >> 2 & 1u) mask &= maskOfYZ(insideEdges(0, p));
  if (groups >> 3 & 1u) mask &= maskOfXZ(insideEdges(1, p));
  if (groups >> 4 & 1u) mask &= maskOfXY(insideEdges(2, p));
  return (groups & 1u) != 0 ? nearPlane(p, mask) : mask;
}

}  // namespace asvo
