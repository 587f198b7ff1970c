// Small scenes made in memory for tests.
#pragma once

#include "src/scene/scene.h"

namespace trex::test {

/// A Lambertian material of one albedo and emission.
inline Material lambert(float albedo, float emission = 0.0f) {
  Material m;
  m.baseColor = vec4(albedo, albedo, albedo, 1.0f);
  m.metallic = 0.0f;
  m.roughness = 1.0f;
  m.specular = 0.0f;
  m.emission = vec3(emission);
  return m;
}

/// A level square from (low, low) to (high, high) that faces up or down, with a texture's u along x
/// and v along z.
inline Mesh panel(float low, float high, float height, int material, bool up) {
  Mesh mesh;
  mesh.material = material;
  mesh.positions = {vec3(low, height, low), vec3(high, height, low), vec3(high, height, high),
                    vec3(low, height, high)};
  mesh.texCoords = {vec2(0.0f, 0.0f), vec2(1.0f, 0.0f), vec2(1.0f, 1.0f), vec2(0.0f, 1.0f)};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  if (up) mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  return mesh;
}

/// The twelve triangles of a box; fronts look inwards or outwards.
inline Mesh box(const vec3& lower, const vec3& upper, int material, bool inwards) {
  Mesh mesh;
  mesh.material = material;
  for (int i = 0; i < 8; ++i) {
    mesh.positions.emplace_back(i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y,
                                i & 4 ? upper.z : lower.z);
  }
  constexpr unsigned kQuads[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                     {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& q : kQuads) {
    const glm::uvec3 a(q[0], q[1], q[2]), b(q[0], q[2], q[3]);
    mesh.triangles.push_back(inwards ? glm::uvec3(a.x, a.z, a.y) : a);
    mesh.triangles.push_back(inwards ? glm::uvec3(b.x, b.z, b.y) : b);
  }
  return mesh;
}

/// A sphere of 2 * n * n triangles.
inline Mesh sphere(const vec3& centre, float radius, int material, unsigned n) {
  Mesh mesh;
  mesh.material = material;
  for (unsigned i = 0; i <= n; ++i) {
    for (unsigned j = 0; j <= n; ++j) {
      const float theta = kPi * static_cast<float>(i) / static_cast<float>(n);
      const float phi = 2.0f * kPi * static_cast<float>(j % n) / static_cast<float>(n);
      mesh.positions.push_back(centre + radius * vec3(std::sin(theta) * std::cos(phi),
                                                      std::cos(theta),
                                                      -std::sin(theta) * std::sin(phi)));
    }
  }
  for (unsigned i = 0; i < n; ++i) {
    for (unsigned j = 0; j < n; ++j) {
      const unsigned a = i * (n + 1) + j, b = a + n + 1;
      mesh.triangles.emplace_back(a, b, a + 1);
      mesh.triangles.emplace_back(a + 1, b, b + 1);
    }
  }
  return mesh;
}

inline void place(Scene& scene, Mesh mesh, const dmat4& transform = dmat4(1.0)) {
  Instance instance;
  instance.mesh = static_cast<int>(scene.meshes.size());
  instance.object = static_cast<int>(scene.instances.size());
  instance.transform = transform;
  scene.meshes.push_back(std::move(mesh));
  scene.instances.push_back(instance);
}

inline Camera lookAt(const dvec3& eye, const dvec3& target, float verticalFov) {
  Camera camera;
  camera.eye = eye;
  camera.forward = vec3(glm::normalize(target - eye));
  const vec3 side = glm::normalize(glm::cross(camera.forward, vec3(0.1f, 1.0f, 0.2f)));
  camera.up = glm::cross(side, camera.forward);
  camera.verticalFov = verticalFov;
  return camera;
}

/// A closed box of 2 m whose walls all emit 1 and reflect `albedo`: radiance is 1 / (1 - albedo)
/// everywhere.
inline Scene furnace(float albedo) {
  Scene scene;
  scene.materials = {lambert(albedo, 1.0f)};
  place(scene, box(vec3(-1.0f), vec3(1.0f), 0, true));
  scene.cameras = {lookAt(dvec3(0.2, 0.1, 0.3), dvec3(1.0, 0.4, -0.2), 1.2f)};
  return scene;
}

/// A lit room with a mirror sphere in front of the camera and a grey one beside it.
inline Scene mirrorRoom() {
  Scene scene;
  scene.materials = {lambert(0.6f), lambert(0.0f, 8.0f), lambert(0.9f)};
  scene.materials[2].metallic = 1.0f;
  scene.materials[2].roughness = 0.0f;
  place(scene, box(vec3(-2.0f), vec3(2.0f), 0, true));
  place(scene, box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
  place(scene, sphere(vec3(-0.8f, 0.0f, -1.0f), 0.6f, 2, 12));
  place(scene, sphere(vec3(0.8f, 0.0f, -1.0f), 0.6f, 0, 12));
  scene.cameras = {lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
  return scene;
}

}  // namespace trex::test
