// Which objects of a look are hidden, and the section plane through a scene.
#pragma once

#include <cstdint>

#include "src/scene/look.h"

namespace trex {

bool isHidden(const Look& look, std::uint32_t object);
void setHidden(Look& look, std::uint32_t object, bool hidden);
/// Hides all objects but one, of `count`.
void isolate(Look& look, std::uint32_t object, std::uint32_t count);

/// A plane through `bounds` with this normal: 0 cuts nothing away, 1 everything.
SectionPlane sectionAt(const Box3d& bounds, const vec3& normal, double share);
/// The share of sectionAt() that gives the plane's place, clamped to [0, 1].
double sectionShare(const Box3d& bounds, const SectionPlane& plane);

}  // namespace trex
