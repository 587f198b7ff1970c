// Convex polygons clipped to boxes: exact areas and moments of the surface inside a cell.
#pragma once

#include <algorithm>
#include <glm/glm.hpp>

namespace asvo {

/// A triangle or quadrangle cut by six planes has at most ten corners.
inline constexpr int kMaxCorners = 12;

/// A convex polygon, relative to the centre of a cell. Corners from `count` on have no value: to
/// give them one would cost as much as clipping.
struct Polygon {
  Polygon() {}
  Polygon(const Polygon& other) { *this = other; }
  Polygon& operator=(const Polygon& other) {
    count = other.count;
    std::copy(other.corner, other.corner + count, corner);
    return *this;
  }
  union {
    glm::vec3 corner[kMaxCorners];
  };
  int count = 0;
};

/// Keeps the part with sign * x[axis] <= bound [Sutherland and Hodgman 1974].
inline void clip(Polygon& polygon, int axis, float sign, float bound) {
  float inside[kMaxCorners];
  bool any = false, all = true;
  for (int i = 0; i < polygon.count; ++i) {
    inside[i] = bound - sign * polygon.corner[i][axis];
    any = any || inside[i] >= 0.0f;
    all = all && inside[i] >= 0.0f;
  }
  if (all) return;
  if (!any) {
    polygon.count = 0;
    return;
  }
  Polygon out;
  for (int i = 0; i < polygon.count && out.count < kMaxCorners - 1; ++i) {
    const int j = i + 1 == polygon.count ? 0 : i + 1;
    if (inside[i] >= 0.0f) out.corner[out.count++] = polygon.corner[i];
    if ((inside[i] >= 0.0f) != (inside[j] >= 0.0f)) {
      // From the inner end, so that both cells beside a face compute the same point.
      const int from = inside[i] >= 0.0f ? i : j, to = inside[i] >= 0.0f ? j : i;
      const float part = inside[from] / (inside[from] - inside[to]);
      glm::vec3 p = polygon.corner[from] + (polygon.corner[to] - polygon.corner[from]) * part;
      p[axis] = sign * bound;
      out.corner[out.count++] = p;
    }
  }
  polygon = out;
}

/// Keeps the part inside the box around the centre, of half edge `half` on each axis. `below`,
/// `above`: whether it may reach beyond the lower and upper faces.
inline void clipToBox(Polygon& polygon, const glm::vec3& half,
                      const glm::bvec3& below = glm::bvec3(true),
                      const glm::bvec3& above = glm::bvec3(true)) {
  for (int axis = 0; axis < 3 && polygon.count > 0; ++axis) {
    if (above[axis]) clip(polygon, axis, 1.0f, half[axis]);
    if (below[axis] && polygon.count > 0) clip(polygon, axis, -1.0f, half[axis]);
  }
}

/// Integrals of 1, x and x x^T over a surface.
struct Moments {
  float area = 0.0f;
  glm::vec3 first{0.0f};
  glm::vec3 diagonal{0.0f};  ///< xx, yy, zz
  glm::vec3 mixed{0.0f};     ///< yz, zx, xy

  void add(const Moments& m, float weight) {
    area += weight * m.area;
    first += weight * m.first;
    diagonal += weight * m.diagonal;
    mixed += weight * m.mixed;
  }
  /// The same surface in coordinates scale * x + shift, its area as it is.
  Moments moved(float scale, const glm::vec3& shift) const {
    auto turn = [](const glm::vec3& v) { return glm::vec3(v.y, v.z, v.x); };
    auto turnBack = [](const glm::vec3& v) { return glm::vec3(v.z, v.x, v.y); };
    Moments m;
    m.area = area;
    m.first = scale * first + area * shift;
    m.diagonal = scale * scale * diagonal + 2.0f * scale * first * shift + area * shift * shift;
    m.mixed = scale * scale * mixed + area * turn(shift) * turnBack(shift) +
              scale * (turn(first) * turnBack(shift) + turnBack(first) * turn(shift));
    return m;
  }
  glm::vec3 mean() const { return first / area; }
  /// Variance of the height along a unit normal.
  float variance(const glm::vec3& n) const {
    const float height = glm::dot(n, mean());
    const glm::vec3 twice(2.0f * n.y * n.z, 2.0f * n.z * n.x, 2.0f * n.x * n.y);
    return (glm::dot(diagonal, n * n) + glm::dot(mixed, twice)) / area - height * height;
  }
};

/// Moments by a fan of triangles; parts that face against the normal (rounding) count as nothing.
inline Moments momentsOf(const Polygon& polygon, const glm::vec3& normal) {
  Moments m;
  for (int i = 2; i < polygon.count; ++i) {
    const glm::vec3 a = polygon.corner[0], b = polygon.corner[i - 1], c = polygon.corner[i];
    const float part = std::max(0.0f, 0.5f * glm::dot(glm::cross(b - a, c - a), normal));
    const glm::vec3 sum = a + b + c;
    auto mixed = [](const glm::vec3& v) { return glm::vec3(v.y * v.z, v.z * v.x, v.x * v.y); };
    m.area += part;
    m.first += part / 3.0f * sum;
    m.diagonal += part / 12.0f * (a * a + b * b + c * c + sum * sum);
    m.mixed += part / 12.0f * (mixed(a) + mixed(b) + mixed(c) + mixed(sum));
  }
  return m;
}

/// Centre of a polygon, also of one without area.
inline glm::vec3 centroidOf(const Polygon& polygon, const Moments& moments) {
  if (moments.area > 1e-9f) return moments.mean();
  glm::vec3 sum(0.0f);
  for (int i = 0; i < polygon.count; ++i) sum += polygon.corner[i];
  return sum / static_cast<float>(std::max(polygon.count, 1));
}

}  // namespace asvo
