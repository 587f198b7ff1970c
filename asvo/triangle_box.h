// Triangle against boxes of a grid: the separating axis tests of [Schwarz and Seidel 2010] written
// as linear functions, so that the eight children of a cell cost a few additions each.
//
// Lengths are in sub-voxels; the grid has its origin at the corner of the cube.
#pragma once

#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>

#include "asvo/asvo.h"

namespace asvo {

/// Four tests at a time.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

/// One bit a group of four tests that may still fail inside the present cell.
using GroupMask = std::uint32_t;

/// A triangle ready to be tested against boxes with lower corner p and edge s. Test i passes if
/// a[i] . p + b0[i] + s * b1[i] >= 0; a box overlaps the triangle if all pass. Normalised, and b0
/// includes the tolerance, so that rounding never loses a box that the triangle touches.
///
/// Group 0: plane (2), bounds on the dominant axis (2). Group 1: bounds on the others. Groups 2..4:
/// three edges in each of three projections. The order puts what stays undecided inside a large
/// triangle into group 0.
struct TriangleBox {
  static constexpr int kGroups = 5;
  static constexpr GroupMask kAllGroups = (1u << kGroups) - 1u;

  Float4 ax[kGroups], ay[kGroups], az[kGroups], b0[kGroups], b1[kGroups];

  TriangleBox(const glm::dvec3 vertex[3], const glm::dvec3& normal, double tolerance);

  /// Bits of the children (edge `half`) of the cell at p that the triangle overlaps.
  std::uint32_t children(const glm::vec3& p, float half, GroupMask groups) const;
  /// The groups that can still fail for boxes inside the cell at p with edge s.
  GroupMask undecided(const glm::vec3& p, float s, GroupMask groups) const;
  /// Occupancy of the 4x4x4 sub-voxels of the leaf at p.
  std::uint64_t subVoxels(const glm::vec3& p, GroupMask groups) const;

 private:
  void set(int test, const glm::dvec3& a, double b, double tolerance);
};

inline bool anyNegative(Int4 v) {
#ifdef __SSE__
  return __builtin_ia32_movmskps(reinterpret_cast<Float4>(v)) != 0;
#else
  return (v[0] | v[1] | v[2] | v[3]) < 0;
#endif
}

inline Float4 splat(float x) { return Float4{x, x, x, x}; }

/// a . p + b >= 0 for some point p of a box: the box's largest value of a . p is added through b1.
inline void TriangleBox::set(int test, const glm::dvec3& a, double b, double tolerance) {
  const double length = glm::length(a);
  const double scale = length > 0.0 ? 1.0 / length : 0.0;
  const glm::dvec3 n = a * scale;
  const int group = test / 4, lane = test % 4;
  ax[group][lane] = static_cast<float>(n.x);
  ay[group][lane] = static_cast<float>(n.y);
  az[group][lane] = static_cast<float>(n.z);
  b0[group][lane] = static_cast<float>(length > 0.0 ? b * scale + tolerance : 1.0);
  const glm::dvec3 up = glm::max(n, glm::dvec3(0.0));
  b1[group][lane] = static_cast<float>(up.x + up.y + up.z);
}

inline TriangleBox::TriangleBox(const glm::dvec3 vertex[3], const glm::dvec3& normal,
                                double tolerance) {
  const glm::dvec3 lower = glm::min(vertex[0], glm::min(vertex[1], vertex[2]));
  const glm::dvec3 upper = glm::max(vertex[0], glm::max(vertex[1], vertex[2]));
  const glm::dvec3 size = glm::abs(normal);
  const int dominant = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
  set(0, normal, -glm::dot(normal, vertex[0]), tolerance);
  set(1, -normal, glm::dot(normal, vertex[0]), tolerance);
  for (int i = 0; i < 3; ++i) {
    const int axis = (dominant + i) % 3;
    glm::dvec3 a(0.0);
    a[axis] = 1.0;
    set(2 + 2 * i, a, -lower[axis], tolerance);
    set(3 + 2 * i, -a, upper[axis], tolerance);
  }
  int test = 8;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const double sign = normal[axis] >= 0.0 ? 1.0 : -1.0;
    for (int e = 0; e < 3; ++e, ++test) {
      const glm::dvec3 edge = vertex[(e + 1) % 3] - vertex[e];
      glm::dvec3 a(0.0);
      a[u] = -sign * edge[v];
      a[v] = sign * edge[u];
      set(test, a, -glm::dot(a, vertex[e]), tolerance);
    }
  }
  for (; test < 4 * kGroups; ++test) {
    set(test, glm::dvec3(0.0), 1.0, tolerance);
  }
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

inline std::uint64_t TriangleBox::subVoxels(const glm::vec3& p, GroupMask groups) const {
  std::uint64_t mask = 0;
  const std::uint32_t octants = children(p, 2.0f, groups);
  for (int octant = 0; octant < 8; ++octant) {
    if ((octants >> octant & 1u) == 0) continue;
    const int x = (octant & 1) * 2, y = (octant >> 1 & 1) * 2, z = (octant >> 2) * 2;
    const glm::vec3 q = p + glm::vec3(x, y, z);
    const std::uint64_t m = children(q, 1.0f, groups);
    // Bits of an octant (x, 2y, 4z) to bits of the leaf (x, 4y, 16z).
    const std::uint64_t spread =
        (m & 3u) | (m >> 2 & 3u) << 4 | (m >> 4 & 3u) << 16 | (m >> 6 & 3u) << 20;
    mask |= spread << (x + 4 * y + 16 * z);
  }
  return mask;
}

}  // namespace asvo
