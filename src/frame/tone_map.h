// From scene radiance to what a screen shows.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// How radiance beyond what a screen can show is brought into its range. Where each comes from:
/// tone_map.cpp.
enum class ToneOperator : std::uint8_t {
  kCut,      ///< each channel is cut at 1: exact below, but highlights change their hue
  kNeutral,  ///< Khronos PBR Neutral: nearly exact up to 0.76, then towards white
  kAgx,      ///< AgX: soft, colours fade towards white over 16.5 stops
};

/// Of captures and the viewer.
inline constexpr ToneOperator kDefaultToneOperator = ToneOperator::kNeutral;

/// "none", "neutral", "agx": in the order of the enumeration.
const std::vector<std::string>& toneOperatorNames();

/// What the screen is to send out, linear, [0, 1], for radiance at its exposure. Values that are
/// negative or not a number count as 0.
vec3 toScreen(vec3 exposed, ToneOperator toneOperator);

/// Maps scene radiance (linear Rec. 709) to the screen: exposure in stops, the operator, sRGB.
struct ToneMap {
  float exposure = 0.0f;
  ToneOperator toneOperator = ToneOperator::kCut;
  /// sRGB encoded, [0, 1].
  vec3 apply(const vec3& radiance) const;
};

}  // namespace trex
