// Lights as people think of them: a colour and a power, or an irradiance of a sun.
#pragma once

#include <string>

#include "src/scene/scene.h"

namespace trex {

/// Solid angle that the light shines into, weighted by its falloff, steradians; 1 for a
/// directional light.
float lightSolidAngle(const Light& light);

/// The colour, its largest channel 1; white for a light that is off.
vec3 lightColor(const Light& light);
/// W of the largest channel; W/m^2 for a directional light.
float lightPower(const Light& light);
/// Sets the intensity from both.
void setLight(Light& light, const vec3& color, float power);

/// "point", "spot", "sun".
const char* lightTypeName(Light::Type type);

/// A new light in front of a camera, at `distance` from its eye: a lamp that lights the pivot as a
/// 100 W bulb does a table, scaled to the scene; a sun of 3 W/m^2 that shines obliquely down.
Light newLight(Light::Type type, const Camera& camera, double distance, double sceneSize);

/// Emission as colour and strength: the colour's largest channel is 1 (white if there is none).
void splitEmission(const vec3& emission, vec3& color, float& strength);

}  // namespace trex
