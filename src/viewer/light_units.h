// Lights as people think of them: a colour and a power, or an irradiance of a sun.
#pragma once

#include <string>

#include "src/scene/look.h"

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

/// A new light between the camera's eye and the pivot `distance` away: with the look's exposure it
/// brings a grey surface there to the middle of the screen's range. A sun shines obliquely down.
Light newLight(Light::Type type, const Look& look, double distance, double sceneSize);

/// Emission as colour and strength: the colour's largest channel is 1 (white if there is none).
void splitEmission(const vec3& emission, vec3& color, float& strength);

}  // namespace trex
