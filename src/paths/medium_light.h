// Light that media scatter towards a path, once on each stretch of it. Private to src/paths.
#pragma once

#include "src/crays/clear_path.h"
#include "src/crays/lights.h"
#include "src/crays/media.h"

namespace trex {

/// Of one stretch: what was drawn, and what is known so far. Plain data, so that it can wait for
/// pages.
struct MediumLight {
  MediaStretch stretch{};
  dvec3 point{0.0};     ///< where light is scattered
  vec3 forward{0.0f};   ///< the path's direction
  LightSample light{};  ///< chosen there, if `asks`
  vec3 to{0.0f};        ///< direction that the phase function has chosen, if `looks`
  bool asks = false;    ///< whether that light arrives
  bool looks = false;   ///< for light along `to`
  vec3 sum{0.0f};       ///< of the former, times the phase function
  vec3 along{0.0f};     ///< of the latter
  ClearWalk walk{};     ///< along `to`
  WaitingConnection way{};
};

}  // namespace trex
