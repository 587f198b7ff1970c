#include "src/scene/shape_meshes.h"

#include <algorithm>
#include <functional>

namespace trex::detail {
namespace {

constexpr double kFullTurn = 2.0 * std::numbers::pi;

struct Vertex {
  dvec3 position, normal;
};

/// Pieces of an arc whose chords are off by `error` of its radius.
int piecesOf(double angle, double error) {
  error = std::clamp(error, 1e-5, 0.1);
  const double chord = 2.0 * std::acos(1.0 - error);
  return std::max(
      1, static_cast<int>(std::ceil(std::max(8.0, kFullTurn / chord) * angle / kFullTurn)));
}

/// What the radius is multiplied with so that the polygon of a circle has its area.
double areaKeeping(double pieceAngle) { return std::sqrt(pieceAngle / std::sin(pieceAngle)); }

/// A grid of nu x nv cells over (u, v) in [0, 1]^2; cells that end in a point there are one
/// triangle. u x v must turn about the normal.
Mesh gridMesh(int nu, int nv, const std::function<Vertex(double, double)>& at) {
  Mesh mesh;
  for (int j = 0; j <= nv; ++j) {
    for (int i = 0; i <= nu; ++i) {
      const double u = double(i) / nu, v = double(j) / nv;
      const Vertex vertex = at(u, v);
      mesh.positions.push_back(vec3(vertex.position));
      mesh.normals.push_back(vec3(vertex.normal));
      mesh.texCoords.push_back(vec2(float(u), float(v)));
    }
  }
  const auto index = [&](int i, int j) { return static_cast<std::uint32_t>(j * (nu + 1) + i); };
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const auto& p = mesh.positions;
    if (p[a] != p[b] && p[b] != p[c] && p[c] != p[a]) mesh.triangles.emplace_back(a, b, c);
  };
  for (int j = 0; j < nv; ++j) {
    for (int i = 0; i < nu; ++i) {
      add(index(i, j), index(i + 1, j), index(i + 1, j + 1));
      add(index(i, j), index(i + 1, j + 1), index(i, j + 1));
    }
  }
  return mesh;
}

double clampedPhi(double phi) { return std::clamp(phi, 1e-3, kFullTurn); }

/// A height over the radius as an angle from -z; the poles are exact.
double polarAngle(double height) { return std::acos(std::clamp(-height, -1.0, 1.0)); }

/// Scales positions so that the area of all triangles is `area`.
void setArea(Mesh& mesh, double area) {
  double have = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]);
    have += 0.5 *
            glm::length(glm::cross(dvec3(mesh.positions[t.y]) - a, dvec3(mesh.positions[t.z]) - a));
  }
  if (!(have > 0.0)) return;
  const double factor = std::sqrt(area / have);
  for (vec3& p : mesh.positions) p = vec3(dvec3(p) * factor);
}

}  // namespace

Mesh sphereMesh(const Revolved& part, double error) {
  const double r = part.radius, phi = clampedPhi(part.phiMax);
  const double low = polarAngle(std::min(part.zMin, part.zMax) / r);
  const double high = polarAngle(std::max(part.zMin, part.zMax) / r);
  const auto at = [&](double u, double v) {
    const double theta = low + v * (high - low), p = u * phi;
    const bool pole = theta < 1e-9 || theta > std::numbers::pi - 1e-9;
    const double ring = pole ? 0.0 : std::sin(theta);
    const dvec3 n(ring * std::cos(p), ring * std::sin(p), -std::cos(theta));
    return Vertex{n * r, n};
  };
  // In the middle of a cell the chords of both directions add up.
  Mesh mesh = gridMesh(piecesOf(phi, 0.5 * error), piecesOf(high - low, 0.5 * error), at);
  setArea(mesh, phi * r * r * (std::cos(low) - std::cos(high)));
  mesh.name = "sphere";
  return mesh;
}

Mesh cylinderMesh(const Revolved& part, double error) {
  const double phi = clampedPhi(part.phiMax);
  const int pieces = piecesOf(phi, error);
  const double half = 0.5 * phi / pieces;
  const double r = part.radius * half / std::sin(half);
  const double low = std::min(part.zMin, part.zMax), high = std::max(part.zMin, part.zMax);
  const auto at = [&](double u, double v) {
    const double p = u * phi;
    const dvec3 n(std::cos(p), std::sin(p), 0.0);
    return Vertex{dvec3(r * n.x, r * n.y, low + v * (high - low)), n};
  };
  Mesh mesh = gridMesh(pieces, 1, at);
  mesh.name = "cylinder";
  return mesh;
}

Mesh diskMesh(double radius, double innerRadius, double height, double phiMax, double error) {
  const double phi = clampedPhi(phiMax);
  const int pieces = piecesOf(phi, error);
  const double factor = areaKeeping(phi / pieces);
  innerRadius = std::clamp(innerRadius, 0.0, radius);
  const auto at = [&](double u, double v) {
    const double p = u * phi, r = factor * (radius + v * (innerRadius - radius));
    return Vertex{dvec3(r * std::cos(p), r * std::sin(p), height), dvec3(0.0, 0.0, 1.0)};
  };
  Mesh mesh = gridMesh(pieces, 1, at);
  mesh.name = "disk";
  return mesh;
}

Mesh rectangleMesh() {
  Mesh mesh;
  mesh.name = "rectangle";
  mesh.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  mesh.normals.assign(4, vec3(0.0f, 0.0f, 1.0f));
  mesh.texCoords = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.triangles = {{0, 1, 2}, {2, 3, 0}};
  return mesh;
}

Mesh cubeMesh() {
  // Of each face: where uv is (0, 1), the way of u, and the way of v's fall.
  constexpr std::array<std::array<vec3, 3>, 6> kFaces = {
      {{vec3(1, -1, -1), vec3(0, 0, 2), vec3(-2, 0, 0)},
       {vec3(1, 1, -1), vec3(-2, 0, 0), vec3(0, 0, 2)},
       {vec3(1, -1, -1), vec3(0, 2, 0), vec3(0, 0, 2)},
       {vec3(1, -1, 1), vec3(0, 2, 0), vec3(-2, 0, 0)},
       {vec3(-1, -1, 1), vec3(0, 2, 0), vec3(0, 0, -2)},
       {vec3(1, 1, -1), vec3(0, -2, 0), vec3(-2, 0, 0)}}};
  Mesh mesh;
  mesh.name = "cube";
  for (const auto& [corner, u, v] : kFaces) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    mesh.positions.insert(mesh.positions.end(), {corner, corner + u, corner + u + v, corner + v});
    mesh.normals.insert(mesh.normals.end(), 4, glm::normalize(glm::cross(u, v)));
    mesh.texCoords.insert(mesh.texCoords.end(), {{0, 1}, {1, 1}, {1, 0}, {0, 0}});
    mesh.triangles.emplace_back(first, first + 1, first + 2);
    mesh.triangles.emplace_back(first + 2, first + 3, first);
  }
  return mesh;
}

}  // namespace trex::detail
