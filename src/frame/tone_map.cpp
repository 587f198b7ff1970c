#include "src/frame/tone_map.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

constexpr float kMost = 1e30f;  // radiance that is more than any screen can show

/// Khronos PBR Neutral Tone Mapper, specification 1.0 (E. Dalvizu, E. Chadwick, B. Houston et al.,
/// Khronos Group 2024): takes off the Fresnel reflection of a dielectric, 4 %, keeps colours up to
/// 0.8 - 0.04 as they are, compresses what is above, and lets it lose its saturation.
vec3 neutral(vec3 color) {
  constexpr float kStart = 0.8f - 0.04f, kRoom = 1.0f - kStart, kDesaturation = 0.15f;
  const float least = std::min({color.x, color.y, color.z});
  color -= least < 0.08f ? least - 6.25f * least * least : 0.04f;
  const float peak = std::max({color.x, color.y, color.z});
  if (peak < kStart) return color;
  const float compressed = 1.0f - kRoom * kRoom / (peak + kRoom - kStart);
  const float white = 1.0f - 1.0f / (kDesaturation * (peak - compressed) + 1.0f);
  return glm::mix(color * (compressed / peak), vec3(compressed), white);
}

/// AgX (T. Sobotka 2022) with the matrices and the fit of its curve by B. Wrensch ("Minimal AgX
/// Implementation", 2023): primaries moved inwards, the logarithm of -12.47 to +4.03 stops, a
/// sigmoid, primaries moved back, and the display's power of 2.2.
vec3 agx(const vec3& color) {
  constexpr float kLeastStops = -12.47393f, kMostStops = 4.026069f;
  const glm::mat3 inwards(0.842479062f, 0.0423282423f, 0.0423756549f,  //
                          0.0784336f, 0.878468636f, 0.0784336f,        //
                          0.0792237451f, 0.0791661275f, 0.879142974f);
  const glm::mat3 outwards(1.196879005f, -0.0528968518f, -0.0529716355f,  //
                           -0.0980208811f, 1.15190313f, -0.0980434501f,   //
                           -0.0990297441f, -0.0989611768f, 1.151073673f);
  vec3 x = inwards * color;
  for (int c = 0; c < 3; ++c) {
    const float stops = std::clamp(std::log2(std::max(x[c], 1e-10f)), kLeastStops, kMostStops);
    x[c] = (stops - kLeastStops) / (kMostStops - kLeastStops);
  }
  const vec3 x2 = x * x, x4 = x2 * x2;
  const vec3 curve = 15.5f * x4 * x2 - 40.14f * x4 * x + 31.96f * x4 - 6.868f * x2 * x +
                     0.4298f * x2 + 0.1191f * x - 0.00232f;
  return glm::pow(glm::clamp(outwards * curve, 0.0f, 1.0f), vec3(2.2f));
}

}  // namespace

const std::vector<std::string>& toneOperatorNames() {
  static const std::vector<std::string> names = {"none", "neutral", "agx"};
  return names;
}

vec3 toScreen(vec3 exposed, ToneOperator toneOperator) {
  for (int c = 0; c < 3; ++c) {
    exposed[c] = exposed[c] >= 0.0f ? std::min(exposed[c], kMost) : 0.0f;  // NaN becomes 0
  }
  if (toneOperator == ToneOperator::kNeutral) exposed = neutral(exposed);
  if (toneOperator == ToneOperator::kAgx) exposed = agx(exposed);
  return glm::clamp(exposed, 0.0f, 1.0f);
}

vec3 ToneMap::apply(const vec3& radiance) const {
  const vec3 linear = toScreen(radiance * std::exp2(exposure), toneOperator);
  return vec3(encodeSrgb(linear.x), encodeSrgb(linear.y), encodeSrgb(linear.z));
}

}  // namespace trex
