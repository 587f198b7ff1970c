#include "src/session/mesh_voxel_source.h"

#include <algorithm>
#include <array>

#include "src/core/error.h"
#include "src/crays/ray_scene_parts.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

constexpr int kEvery = -1;  // a mesh whose clusters name their objects themselves

/// The index, as in hits, of triangle number `number` of a cluster.
std::uint32_t indexOf(const hccm::Mesh& mesh, std::uint32_t cluster, std::uint32_t number) {
  std::uint32_t leaf = 0;
  for (;; ++leaf) {
    const std::uint32_t count = mesh.leafTriangleCount(cluster, leaf);
    if (number < count) return 8 * leaf + number;
    number -= count;
  }
}

/// What the plane leaves of a triangle: up to four corners.
int cutTriangle(const Visibility& v, const vec3 (&p)[3], std::array<vec3, 4>& out) {
  int count = 0;
  for (int i = 0; i < 3; ++i) {
    const vec3 &a = p[i], &b = p[(i + 1) % 3];
    const float ha = glm::dot(v.normal, a) - v.offset, hb = glm::dot(v.normal, b) - v.offset;
    if (ha <= 0.0f) out[static_cast<std::size_t>(count++)] = a;
    if ((ha <= 0.0f) != (hb <= 0.0f)) {
      out[static_cast<std::size_t>(count++)] = a + (b - a) * (ha / (ha - hb));
    }
  }
  return count;
}

/// Weights of the second and third corner at a point of the triangle's plane.
vec2 weightsAt(const vec3 (&p)[3], const vec3& point) {
  const vec3 b = p[1] - p[0], c = p[2] - p[0], d = point - p[0];
  const vec3 normal = glm::cross(b, c);
  const float square = glm::dot(normal, normal);
  if (!(square > 0.0f)) return vec2(0.0f);
  return {glm::dot(glm::cross(d, c), normal) / square, glm::dot(glm::cross(b, d), normal) / square};
}

}  // namespace

MeshVoxelSource::MeshVoxelSource(const RayScene& rays, const Scene& scene,
                                 std::vector<Material> materials, const Visibility& visibility)
    : images_(scene.images),
      materials_(std::move(materials)),
      plain_(plainShades(materials_, scene.images)),
      visibility_(visibility) {
  const RayScene::Parts& parts = rays.parts();
  dmat4 world(1.0);
  world[3] = glm::dvec4(parts.world.gridOrigin(), 1.0);
  add(parts.world, world, kEvery);
  for (const RayScene::Parts::Placed& p : parts.placed) {
    const SharedPlace place = placeOf(scene, parts, p);
    add(parts.shared[p.mesh], place.toRender, place.object == kNone ? kEvery : place.object);
  }
  runTable_.finish();
  if (count() > 0xffffffffu) {
    fail(ExitCode::kMemoryOrDevice, "{}: {} triangles, voxels are built from at most 2^32",
         scene.source, count());
  }
}

void MeshVoxelSource::add(const hccm::Mesh& mesh, const dmat4& toRender, int object) {
  if (object != kEvery && !visibility_.shows(static_cast<std::uint32_t>(object))) return;
  const auto place = static_cast<std::uint32_t>(places_.size());
  places_.push_back({&mesh, toRender, glm::determinant(glm::dmat3(toRender)) < 0.0});
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
    if (object == kEvery && !visibility_.shows(mesh.clusterObject(c))) continue;
    if (passesLight(materials_[mesh.clusterMaterial(c)])) continue;
    const bool plain = plain_[mesh.clusterMaterial(c)] && !mesh.triangle(c, 0).hasColors;
    runs_.push_back({place, c, plain});
    runTable_.add(mesh.clusterTriangleCount(c));
  }
}

const MeshVoxelSource::Run& MeshVoxelSource::find(std::uint64_t i, std::uint32_t& triangle) const {
  return runs_[runTable_.find(i, triangle)];
}

void MeshVoxelSource::whole(std::uint64_t i, vec3 (&position)[3], hccm::Triangle& source) const {
  std::uint32_t number = 0;
  const Run& run = find(i, number);
  const Place& place = places_[run.place];
  source = place.mesh->triangle(run.cluster, indexOf(*place.mesh, run.cluster, number));
  for (int k = 0; k < 3; ++k) {
    position[k] = vec3(place.toRender * glm::dvec4(dvec3(source.position[k]), 1.0));
  }
  if (!place.mirrored) return;
  std::swap(position[1], position[2]);
  std::swap(source.texCoord[1], source.texCoord[2]);
  std::swap(source.secondTexCoord[1], source.secondTexCoord[2]);
  std::swap(source.color[1], source.color[2]);
}

void MeshVoxelSource::get(std::uint64_t i, asvo::Triangle& triangle) const {
  hccm::Triangle source;
  vec3 p[3];
  whole(i / pieces(), p, source);
  triangle.material = source.material;
  triangle.shadeKey = static_cast<std::uint32_t>(i);
  if (!visibility_.cut) {
    std::copy(std::begin(p), std::end(p), triangle.position);
    return;
  }
  std::array<vec3, 4> left;
  const int corners = cutTriangle(visibility_, p, left);
  const int second = static_cast<int>(i % 2);  // of the fan around the first corner
  if (second + 3 > corners) {
    for (vec3& q : triangle.position) q = vec3(kInfinity);  // nothing: the builder ignores it
    return;
  }
  triangle.position[0] = left[0];
  triangle.position[1] = left[static_cast<std::size_t>(second) + 1];
  triangle.position[2] = left[static_cast<std::size_t>(second) + 2];
}

bool MeshVoxelSource::uniform(const asvo::Triangle& triangle) const {
  std::uint32_t number = 0;
  return find(triangle.shadeKey / pieces(), number).plain;
}

asvo::Shade MeshVoxelSource::shade(const asvo::Triangle& triangle, float u, float v) const {
  if (uniform(triangle)) return *plain_[triangle.material];
  hccm::Triangle source;
  vec3 p[3];
  whole(triangle.shadeKey / pieces(), p, source);
  vec2 w(u, v);
  if (visibility_.cut) {
    const auto& q = triangle.position;
    w = weightsAt(p, q[0] + u * (q[1] - q[0]) + v * (q[2] - q[0]));
  }
  const auto mix = [&](const auto* values) {
    return (1.0f - w.x - w.y) * values[0] + w.x * values[1] + w.y * values[2];
  };
  vec4 color(1.0f);
  if (source.hasColors) {
    for (vec4& corner : source.color) corner = unpackVertexColor(corner);
    color = mix(source.color);
  }
  return voxelShade(materials_[source.material], images_,
                    {mix(source.texCoord), mix(source.secondTexCoord)}, color);
}

}  // namespace trex
