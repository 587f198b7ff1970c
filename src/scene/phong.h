// Materials of formats older than physically based shading, as metallic-roughness ones.
#pragma once

#include <algorithm>
#include <cmath>

#include "src/core/maths.h"

namespace trex::detail {

/// KHR_materials_specular of a specular colour: a dielectric's own, of ior 1.5, stands for 0.5 and
/// more. `color` is the colour with its largest channel 1; it is left alone if all are 0.
inline float specularOf(const vec3& reflected, vec3& color) {
  const float strongest = maxComponent(reflected);
  if (strongest > 0.0f) color = reflected / strongest;
  return std::clamp(2.0f * strongest, 0.0f, 1.0f);
}

/// Roughness of a Phong exponent: both lobes are equally wide.
inline float roughnessOf(float exponent) { return std::pow(2.0f / (exponent + 2.0f), 0.25f); }

}  // namespace trex::detail
