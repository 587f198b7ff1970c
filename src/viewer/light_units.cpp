#include "src/viewer/light_units.h"

#include <cmath>

namespace trex {

float lightSolidAngle(const Light& light) {
  if (light.type == Light::Type::kDirectional) return 1.0f;
  if (light.type == Light::Type::kPoint) return 4.0f * kPi;
  // The square of a ramp between both cosines integrates to a third (KHR_lights_punctual).
  const float inner = std::cos(light.innerConeAngle), outer = std::cos(light.outerConeAngle);
  return std::max(2.0f * kPi * ((1.0f - inner) + (inner - outer) / 3.0f), 1e-6f);
}

vec3 lightColor(const Light& light) {
  const float most = maxComponent(light.intensity);
  return most > 0.0f ? light.intensity / most : vec3(1.0f);
}

float lightPower(const Light& light) {
  return maxComponent(light.intensity) * lightSolidAngle(light);
}

void setLight(Light& light, const vec3& color, float power) {
  const float most = maxComponent(color);
  const vec3 pure = most > 0.0f ? color / most : vec3(1.0f);
  light.intensity = pure * (std::max(power, 0.0f) / lightSolidAngle(light));
}

const char* lightTypeName(Light::Type type) {
  switch (type) {
    case Light::Type::kPoint:
      return "point";
    case Light::Type::kSpot:
      return "spot";
    default:
      return "sun";
  }
}

Light newLight(Light::Type type, const Look& look, double distance, double sceneSize) {
  const Camera& camera = look.camera;
  Light light;
  light.type = type;
  light.name = lightTypeName(type);
  const dvec3 pivot = camera.eye + distance * dvec3(camera.forward);
  light.position = pivot + distance * (0.2 * dvec3(camera.up) - 0.4 * dvec3(camera.forward));
  light.direction = vec3(glm::normalize(pivot - light.position));
  // A surface of albedo 0.5 then sends out half of what the screen shows as white.
  const float irradiance = kPi * std::exp2(-look.exposure);
  if (type == Light::Type::kDirectional) {
    light.direction = glm::normalize(vec3(-0.4f, -1.0f, -0.3f));
    setLight(light, vec3(1.0f), irradiance);
    return light;
  }
  light.radius = static_cast<float>(0.01 * sceneSize);
  if (type == Light::Type::kSpot) light.innerConeAngle = 0.6f * light.outerConeAngle;
  const auto away = static_cast<float>(glm::length(pivot - light.position));
  setLight(light, vec3(1.0f), irradiance * away * away * lightSolidAngle(light));
  return light;
}

void splitEmission(const vec3& emission, vec3& color, float& strength) {
  strength = maxComponent(emission);
  color = strength > 0.0f ? emission / strength : vec3(1.0f);
}

}  // namespace trex
