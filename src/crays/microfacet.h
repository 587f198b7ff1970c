// The GGX and Beckmann distributions in a frame whose z axis is the normal. alpha = roughness^2 in
// [kSmallestAlpha, 1]. Visible normals of GGX are sampled after [Heitz, JCGT 2018].
#pragma once

#include "src/core/maths.h"

namespace trex {

/// Below this a lobe counts as perfectly smooth.
inline constexpr float kSmallestAlpha = 1e-3f;
/// Up to here a lobe is sharp: what it throws of a point-like light is a caustic (caustics.h).
inline constexpr float kSharpAlpha = 0.1f;
/// Of roughness 0.1, itself included as it is rounded: what is seen in the surface is blurred by
/// some pixels and known all the same.
inline constexpr float kClearAlpha = 0.1f * 0.1f;

inline float ggxDensity(float cosine, float alpha) {
  if (cosine <= 0.0f) return 0.0f;
  // 1 + (a^2 - 1) c^2 written so that it does not cancel for small alpha.
  const float a2 = alpha * alpha, c2 = cosine * cosine;
  const float d = a2 * c2 + (1.0f - c2);
  return a2 / (kPi * d * d);
}

/// Smith's Lambda.
inline float ggxLambda(float cosine, float alpha) {
  const float c2 = cosine * cosine;
  const float tan2 = (1.0f - c2) / std::max(c2, 1e-14f);
  return 0.5f * (std::sqrt(1.0f + alpha * alpha * std::max(tan2, 0.0f)) - 1.0f);
}
inline float ggxMasking(float cosine, float alpha) {
  return 1.0f / (1.0f + ggxLambda(cosine, alpha));
}
/// Height-correlated masking and shadowing of two directions on the same side.
inline float ggxMaskingShadowing(float cosOut, float cosIn, float alpha) {
  return 1.0f / (1.0f + ggxLambda(cosOut, alpha) + ggxLambda(cosIn, alpha));
}

/// Density of ggxSampleVisible per solid angle of the micro normal; out.z > 0.
inline float ggxVisiblePdf(const vec3& out, const vec3& micro, float alpha) {
  return ggxMasking(out.z, alpha) * std::max(glm::dot(out, micro), 0.0f) *
         ggxDensity(micro.z, alpha) / out.z;
}

/// A micro normal visible from `out` (out.z > 0), of a roughness along each axis.
inline vec3 ggxSampleVisible(const vec3& out, float alphaX, float alphaY, vec2 u) {
  const vec3 stretched = glm::normalize(vec3(alphaX * out.x, alphaY * out.y, out.z));
  const float length2 = stretched.x * stretched.x + stretched.y * stretched.y;
  const vec3 t1 = length2 > 0.0f ? vec3(-stretched.y, stretched.x, 0.0f) / std::sqrt(length2)
                                 : vec3(1.0f, 0.0f, 0.0f);
  const vec3 t2 = glm::cross(stretched, t1);
  const float r = std::sqrt(u.x), phi = 2.0f * kPi * u.y;
  const float x = r * std::cos(phi);
  const float blend = 0.5f * (1.0f + stretched.z);
  const float y =
      (1.0f - blend) * std::sqrt(std::max(0.0f, 1.0f - x * x)) + blend * r * std::sin(phi);
  const float z = std::sqrt(std::max(0.0f, 1.0f - x * x - y * y));
  const vec3 n = x * t1 + y * t2 + z * stretched;
  return glm::normalize(vec3(alphaX * n.x, alphaY * n.y, std::max(n.z, 1e-7f)));
}
inline vec3 ggxSampleVisible(const vec3& out, float alpha, vec2 u) {
  return ggxSampleVisible(out, alpha, alpha, u);
}

/// Beckmann's distribution and Smith's Lambda of it, by its rational fit [Walter et al., EGSR
/// 2007].
inline float beckmannDensity(float cosine, float alpha) {
  if (cosine <= 0.0f) return 0.0f;
  const float c2 = cosine * cosine, a2 = alpha * alpha;
  return std::exp((c2 - 1.0f) / (a2 * c2)) / (kPi * a2 * c2 * c2);
}
inline float beckmannLambda(float cosine, float alpha) {
  const float a = cosine / (alpha * std::sqrt(std::max(1.0f - cosine * cosine, 1e-14f)));
  if (a >= 1.6f) return 0.0f;
  return (1.0f - a * (1.259f - 0.396f * a)) / std::max(a * (3.535f + 2.181f * a), 1e-7f);
}
/// A micro normal with density beckmannDensity * cosine.
inline vec3 beckmannSample(float alpha, vec2 u) {
  const float tan2 = -alpha * alpha * std::log(std::max(1.0f - u.x, 1e-30f)),
              phi = 2.0f * kPi * u.y;
  const float z = 1.0f / std::sqrt(1.0f + tan2), r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  return {r * std::cos(phi), r * std::sin(phi), z};
}

/// A direction about +z with density cos / pi.
inline vec3 cosineSample(vec2 u) {
  const float r = std::sqrt(u.x), phi = 2.0f * kPi * u.y;
  return vec3(r * std::cos(phi), r * std::sin(phi), std::sqrt(std::max(0.0f, 1.0f - u.x)));
}

/// Bsdf::photonFactor(): `facing` is the geometric normal, `out` the way back in the basis of the
/// smooth one.
inline float photonFactor(const vec3& facing, const vec3& tangent, const vec3& bitangent,
                          const vec3& normal, const vec3& out, const vec3& next) {
  constexpr float kMost = 16.0f;
  if (normal == facing) return 1.0f;
  const vec3 outgoing = out.x * tangent + out.y * bitangent + out.z * normal;
  const float up = out.z * std::abs(glm::dot(next, facing));
  const float down = std::abs(glm::dot(outgoing, facing) * glm::dot(next, normal));
  return up < kMost * down ? up / down : kMost;
}

}  // namespace trex
