// Reflection of finishes: a layer of fibres, a thin film, a metal by its index.
#pragma once

#include "src/core/maths.h"

namespace trex {

/// A layer of fibres that stand off the surface [Estevez and Kulla 2017: "Charlie"], without its
/// colour. Directions are in a frame whose z axis is the normal, unit, z > 0. alpha = roughness^2,
/// at least kLeastSheenAlpha.
inline constexpr float kLeastSheenAlpha = 0.005f;
/// f * |cos in|.
float sheenReflection(const vec3& out, const vec3& in, float alpha);
/// Share of light from everywhere that it reflects towards `cosine`, [0, 1]; off by up to 0.015.
/// The first call makes a table, in some ten milliseconds. Thread safe.
float sheenAlbedo(float cosine, float alpha);

/// Reflectance of a film of this thickness (nanometres) and index on a base that reflects `f0` at
/// normal incidence, by colour [Belcour and Barla 2017]; outside is air. Linear Rec. 709, [0, 1].
vec3 filmReflectance(float cosine, float ior, float nanometres, const vec3& f0);

/// Fresnel's reflectance of an interface to a metal of this complex index, by colour, unpolarised;
/// cosine in [0, 1]. [0, 1].
vec3 conductorReflectance(float cosine, const vec3& eta, const vec3& k);

}  // namespace trex
