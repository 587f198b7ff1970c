#include "src/viewer/visibility.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

/// Half of the box's extent along a direction.
double halfExtent(const Box3d& bounds, const dvec3& direction) {
  return 0.5 * glm::dot(bounds.size(), glm::abs(direction));
}

}  // namespace

bool isHidden(const Look& look, std::uint32_t object) {
  return std::binary_search(look.hidden.begin(), look.hidden.end(), object);
}

void setHidden(Look& look, std::uint32_t object, bool hidden) {
  const auto at = std::lower_bound(look.hidden.begin(), look.hidden.end(), object);
  const bool there = at != look.hidden.end() && *at == object;
  if (hidden && !there) look.hidden.insert(at, object);
  if (!hidden && there) look.hidden.erase(at);
}

void isolate(Look& look, std::uint32_t object, std::uint32_t count) {
  look.hidden.clear();
  for (std::uint32_t i = 0; i < count; ++i) {
    if (i != object) look.hidden.push_back(i);
  }
}

SectionPlane sectionAt(const Box3d& bounds, const vec3& normal, double share) {
  const dvec3 direction(normal);
  const double half = bounds.empty() ? 0.0 : halfExtent(bounds, direction);
  const dvec3 centre = bounds.empty() ? dvec3(0.0) : bounds.centre();
  return {centre + (1.0 - 2.0 * share) * half * direction, normal};
}

double sectionShare(const Box3d& bounds, const SectionPlane& plane) {
  const dvec3 direction(plane.normal);
  const double half = bounds.empty() ? 0.0 : halfExtent(bounds, direction);
  if (!(half > 0.0)) return 0.0;
  const double along = glm::dot(plane.point - bounds.centre(), direction);
  return std::clamp(0.5 * (1.0 - along / half), 0.0, 1.0);
}

}  // namespace trex
