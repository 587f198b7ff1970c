// A ray that is aimed exactly at an edge or a vertex of a closed mesh.
#pragma once

#include "src/crays/ray_scene.h"
#include "tests/bench/bumpy_sphere.h"

namespace trex::bench {

/// Ray number i, at instance 0 of mesh 0 in the scene. With distance 0 it starts inside the mesh,
/// near its middle; else that far from it (then rays that leave the sphere of radius 0.85, which
/// lies inside, prove nothing and count as hits). A closed mesh is hit by every such ray. Every
/// eighth ray is parallel to an axis.
inline bool crackRayHits(const RayScene& rays, const Scene& scene, std::uint64_t i,
                         double distance) {
  const Mesh& mesh = scene.meshes[0];
  const dmat4& transform = scene.instances[0].transform;
  const auto toRender = [&](const dvec3& p) {
    return dvec3(transform * glm::dvec4(p + mesh.origin, 1.0)) - rays.renderOrigin();
  };
  const std::uint64_t key = i * 8;
  const glm::uvec3 t = mesh.triangles[mix(key) % mesh.triangles.size()];
  const dvec3 a = toRender(dvec3(mesh.positions[t.x])), b = toRender(dvec3(mesh.positions[t.y]));
  const float along = i % 2 == 0 ? 0.0f : uniform(key + 1);  // a vertex, or a point of an edge
  const vec3 target(a + (b - a) * double(along));
  const vec3 centre(toRender(dvec3(0.0)));
  const vec3 random(uniform(key + 2) - 0.5f, uniform(key + 3) - 0.5f, uniform(key + 4) - 0.5f);
  vec3 origin = centre + random * 0.5f;
  if (distance > 0.0) origin = centre + glm::normalize(random) * static_cast<float>(distance);
  const bool parallel = i % 8 < 2;
  if (parallel && distance == 0.0) {  // starts next to the centre, if the target's offset allows
    const int axis = static_cast<int>(i / 8 % 3);
    const vec3 offset = target - centre;
    vec3 direction(0.0f);
    direction[axis] = offset[axis] < 0.0f ? -1.0f : 1.0f;
    if (std::abs(offset[axis]) > 0.8f) {
      origin = target;
      origin[axis] = centre[axis];
      RayHit hit;
      return rays.intersect(origin, direction, 0.0f, kInfinity, hit) &&
             rays.occluded(origin, direction, 0.0f, kInfinity);
    }
  }
  const vec3 direction = glm::normalize(target - origin);
  if (distance > 0.0) {  // single precision may aim past the mesh: the exact ray decides
    const dvec3 d = glm::normalize(dvec3(direction)), offset = dvec3(centre) - dvec3(origin);
    if (glm::length(offset - d * glm::dot(offset, d)) > 0.85) return true;
  }
  RayHit hit;
  return rays.intersect(origin, direction, 0.0f, kInfinity, hit) &&
         rays.occluded(origin, direction, 0.0f, kInfinity);
}

}  // namespace trex::bench
