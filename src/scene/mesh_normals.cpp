#include "src/scene/mesh_normals.h"

#include <algorithm>
#include <cstring>
#include <numeric>

namespace trex::detail {
namespace {

dvec3 unit(const dvec3& v) {
  const double length = glm::length(v);
  return length > 0.0 && std::isfinite(length) ? v / length : dvec3(0.0);
}

dvec3 positionOf(const Mesh& mesh, const glm::uvec3& t, int corner) {
  return dvec3(mesh.positions[t[corner]]);
}

dvec3 normalOfFace(const Mesh& mesh, const glm::uvec3& t) {
  const dvec3 a = positionOf(mesh, t, 0);
  return unit(glm::cross(positionOf(mesh, t, 1) - a, positionOf(mesh, t, 2) - a));
}

double angleAt(const Mesh& mesh, const glm::uvec3& t, int corner) {
  const dvec3 p = positionOf(mesh, t, corner);
  const dvec3 u = unit(positionOf(mesh, t, (corner + 1) % 3) - p);
  const dvec3 v = unit(positionOf(mesh, t, (corner + 2) % 3) - p);
  return std::acos(std::clamp(glm::dot(u, v), -1.0, 1.0));
}

vec3 usable(const dvec3& sum, const dvec3& otherwise) {
  const dvec3 n = unit(sum);
  return vec3(n != dvec3(0.0) ? n : otherwise != dvec3(0.0) ? otherwise : dvec3(0.0, 1.0, 0.0));
}

/// Corners (3 * triangle + corner) ordered so that those at equal places follow each other.
std::vector<std::size_t> cornersByPlace(const Mesh& mesh) {
  std::vector<std::size_t> corners(3 * mesh.triangles.size());
  std::iota(corners.begin(), corners.end(), std::size_t{0});
  const auto place = [&](std::size_t c) {
    return mesh.positions[mesh.triangles[c / 3][int(c % 3)]];
  };
  std::stable_sort(corners.begin(), corners.end(), [&](std::size_t a, std::size_t b) {
    const vec3 p = place(a), q = place(b);
    return std::tie(p.x, p.y, p.z) < std::tie(q.x, q.y, q.z);
  });
  return corners;
}

}  // namespace

void makeSmoothNormals(Mesh& mesh) {
  std::vector<dvec3> sums(mesh.positions.size(), dvec3(0.0));
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 normal = normalOfFace(mesh, t);
    for (int k = 0; k < 3; ++k) sums[t[k]] += angleAt(mesh, t, k) * normal;
  }
  mesh.normals.clear();
  for (const dvec3& sum : sums) mesh.normals.push_back(usable(sum, dvec3(0.0)));
}

void makeNormalsByAngle(Mesh& mesh, double largestAngle) {
  constexpr std::size_t kMostCorners = 512;
  const double least = std::cos(largestAngle);
  const std::vector<std::size_t> corners = cornersByPlace(mesh);
  const auto vertexOf = [&](std::size_t c) { return mesh.triangles[c / 3][int(c % 3)]; };
  std::vector<vec3> normals(corners.size());
  for (std::size_t first = 0, end = 0; first < corners.size(); first = end) {
    const vec3 place = mesh.positions[vertexOf(corners[first])];
    for (end = first; end < corners.size(); ++end) {
      if (mesh.positions[vertexOf(corners[end])] != place) break;
    }
    const bool flat = end - first > kMostCorners;
    for (std::size_t i = first; i < end; ++i) {
      const dvec3 own = normalOfFace(mesh, mesh.triangles[corners[i] / 3]);
      dvec3 sum(0.0);
      for (std::size_t j = first; j < end && !flat; ++j) {
        const glm::uvec3& t = mesh.triangles[corners[j] / 3];
        const dvec3 other = normalOfFace(mesh, t);
        if (glm::dot(own, other) >= least) sum += angleAt(mesh, t, int(corners[j] % 3)) * other;
      }
      normals[corners[i]] = usable(sum, own);
    }
  }
  // Each corner a vertex of its own; equal ones are found again when the mesh is packed.
  Mesh split;
  for (std::size_t c = 0; c < normals.size(); ++c) {
    const std::uint32_t v = vertexOf(c);
    split.positions.push_back(mesh.positions[v]);
    if (!mesh.texCoords.empty()) split.texCoords.push_back(mesh.texCoords[v]);
    if (!mesh.secondTexCoords.empty()) split.secondTexCoords.push_back(mesh.secondTexCoords[v]);
    if (!mesh.colors.empty()) split.colors.push_back(mesh.colors[v]);
  }
  mesh.positions = std::move(split.positions);
  mesh.texCoords = std::move(split.texCoords);
  mesh.secondTexCoords = std::move(split.secondTexCoords);
  mesh.colors = std::move(split.colors);
  mesh.normals = std::move(normals);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto c = static_cast<std::uint32_t>(3 * i);
    mesh.triangles[i] = {c, c + 1, c + 2};
  }
}

}  // namespace trex::detail
