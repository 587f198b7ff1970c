#include "src/scene/polygon.h"

#include <algorithm>
#include <cmath>

namespace trex::detail {
namespace {

/// Points looked at for one polygon: 0.2 s. An outline of 10000 corners stays below.
constexpr std::uint64_t kMostWork = 200'000'000;

}  // namespace

double PolygonCutter::cross(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
  const Vec u = flat_[b] - flat_[a], v = flat_[c] - flat_[a];
  return u.x * v.y - u.y * v.x;
}

/// Corners along the axis that the normal is nearest to; false if there is no normal.
bool PolygonCutter::project(std::span<const dvec3> corners) {
  dvec3 normal(0.0);  // Newell's
  const dvec3& first = corners[0];
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    normal += glm::cross(corners[i] - first, corners[i + 1] - first);
  }
  const dvec3 size = glm::abs(normal);
  const double largest = std::max({size.x, size.y, size.z});
  if (!(largest > 0.0) || !std::isfinite(largest)) return false;
  const int axis = size.x == largest ? 0 : size.y == largest ? 1 : 2;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  flat_.clear();
  for (const dvec3& p : corners) {
    const dvec3 q = p - first;
    flat_.push_back(normal[axis] > 0.0 ? Vec(q[u], q[v]) : Vec(q[v], q[u]));
  }
  return true;
}

/// All corners turn left, and once around: the triangles of the fan do not overlap.
bool PolygonCutter::convex() const {
  const auto n = static_cast<std::uint32_t>(flat_.size());
  for (std::uint32_t i = 0; i < n; ++i) {
    if (cross(i, (i + 1) % n, (i + 2) % n) < 0.0) return false;
    if (i >= 1 && i + 1 < n && cross(0, i, i + 1) < 0.0) return false;
  }
  return true;
}

bool PolygonCutter::isEar(std::uint32_t corner) {
  const std::uint32_t a = before_[corner], c = after_[corner];
  const Vec &p = flat_[a], &q = flat_[corner], &r = flat_[c];
  const Vec lower = glm::min(p, glm::min(q, r)), upper = glm::max(p, glm::max(q, r));
  work_ += reflex_.size();
  for (const std::uint32_t i : reflex_) {
    const Vec& x = flat_[i];
    if (x.x < lower.x || x.x > upper.x || x.y < lower.y || x.y > upper.y) continue;
    // Corners of other parts of the outline may lie where this triangle's do.
    if (x == p || x == q || x == r) continue;
    if (cross(a, corner, i) >= 0.0 && cross(corner, c, i) >= 0.0 && cross(c, a, i) >= 0.0) {
      return false;
    }
  }
  return true;
}

/// What is left of the outline, from one of its corners.
void PolygonCutter::fan(std::uint32_t first) {
  for (std::uint32_t at = after_[first]; after_[at] != first; at = after_[at]) {
    triangles_.push_back({first, at, after_[at]});
  }
}

void PolygonCutter::clip() {
  std::uint32_t left = static_cast<std::uint32_t>(flat_.size()), at = 0;
  for (std::uint32_t refused = 0; left > 3;) {
    const std::uint32_t a = before_[at], c = after_[at];
    const double turn = cross(a, at, c);
    if (turn < 0.0 || (turn > 0.0 && !isEar(at))) {
      if (++refused > left || work_ > kMostWork) {
        failed_ = true;
        break;
      }
      at = c;
      continue;
    }
    // A corner on a straight line leaves a triangle without area.
    triangles_.push_back({a, at, c});
    after_[a] = c;
    before_[c] = a;
    --left;
    refused = 0;
    // Corners only ever become less reflex.
    std::erase_if(reflex_, [&](std::uint32_t i) {
      return i == at || ((i == a || i == c) && cross(before_[i], i, after_[i]) > 0.0);
    });
    at = after_[c];  // not the next one: long thin fans would come of it
  }
  fan(at);
}

std::span<const glm::uvec3> PolygonCutter::cut(std::span<const dvec3> corners) {
  triangles_.clear();
  failed_ = false;
  work_ = 0;
  const auto n = static_cast<std::uint32_t>(corners.size());
  if (n < 3) return {};
  if (n > 3 && project(corners) && !convex()) {
    before_.resize(n);
    after_.resize(n);
    reflex_.clear();
    for (std::uint32_t i = 0; i < n; ++i) {
      before_[i] = (i + n - 1) % n;
      after_[i] = (i + 1) % n;
      if (cross(before_[i], i, after_[i]) <= 0.0) reflex_.push_back(i);
    }
    clip();
    return triangles_;
  }
  for (std::uint32_t i = 1; i + 1 < n; ++i) triangles_.push_back({0, i, i + 1});
  return triangles_;
}

}  // namespace trex::detail
