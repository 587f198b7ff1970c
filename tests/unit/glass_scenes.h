// Glass over dark floors, for tests of light that passes or is bent by it.
#pragma once

#include "tests/unit/scenes.h"

namespace trex::test {

/// Smooth clear glass: a volume's face or a thin sheet.
inline Material glass(bool volume) {
  Material m;
  m.metallic = 0.0f;
  m.roughness = 0.0f;
  m.transmission = 1.0f;
  m.volume = volume;
  return m;
}

/// A square of half side `half` about (0, y, 0), front upwards, turned about z by `tilt`.
inline Mesh sheet(float half, float y, int material, float tilt = 0.0f) {
  Mesh mesh;
  mesh.material = material;
  const vec3 x(std::cos(tilt), std::sin(tilt), 0.0f), z(0.0f, 0.0f, 1.0f), c(0.0f, y, 0.0f);
  mesh.positions = {c - half * x - half * z, c - half * x + half * z, c + half * x + half * z,
                    c + half * x - half * z};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

/// A pane from y to y + thickness.
inline Mesh pane(float half, float y, float thickness, int material) {
  return box(vec3(-half, y, -half), vec3(half, y + thickness, half), material, false);
}

inline Light pointLight(const dvec3& position, float intensity) {
  Light light;
  light.position = position;
  light.intensity = vec3(intensity);
  return light;
}

inline Light sun(const vec3& direction, float irradiance) {
  Light light;
  light.type = Light::Type::kDirectional;
  light.direction = glm::normalize(direction);
  light.intensity = vec3(irradiance);
  return light;
}

}  // namespace trex::test
