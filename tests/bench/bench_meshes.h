// Three kinds of unique geometry of any size for figures: a scan, a terrain and an assembly of
// parts.
#pragma once

#include <algorithm>
#include <cstring>
#include <string>

#include "tests/bench/bumpy_sphere.h"

namespace trex::bench {

/// The bumpy sphere as a scanner would see it: samples lie up to a third of their distance off
/// their place, a thirtieth of it off the surface, and half of the diagonals run the other way.
/// Closed.
inline Mesh scanMesh(double triangles) {
  const int n = std::max(1, static_cast<int>(std::lround(std::sqrt(triangles / 12.0))));
  Mesh mesh = bumpySphere(n, false);
  mesh.name = "scan";
  const float spacing = 1.6f / static_cast<float>(n);
  for (vec3& p : mesh.positions) {
    // From the place alone: samples on the cube's edges exist twice.
    std::uint32_t bits[3];
    std::memcpy(bits, &p, sizeof(bits));
    const std::uint64_t key = mix(mix(mix(bits[0]) ^ bits[1]) ^ bits[2]);
    const vec3 out = glm::normalize(p);
    const vec3 random(uniform(key) - 0.5f, uniform(key + 1) - 0.5f, uniform(key + 2) - 0.5f);
    const vec3 along = random - out * glm::dot(random, out);
    p += spacing * (0.66f * along + 0.06f * (uniform(key + 3) - 0.5f) * out);
  }
  for (std::size_t i = 0; i + 1 < mesh.triangles.size(); i += 2) {
    if (mix(i) & 1) continue;
    glm::uvec3 &a = mesh.triangles[i], &b = mesh.triangles[i + 1];  // v00 v10 v11, v00 v11 v01
    const glm::uvec4 quad(a.x, a.y, a.z, b.z);
    a = {quad.x, quad.y, quad.w};
    b = {quad.y, quad.z, quad.w};
  }
  return mesh;
}

/// A ball of long thin triangles: few rings, many columns. Closed.
inline Mesh needleMesh(double triangles) {
  constexpr std::uint32_t kRings = 6;
  const auto columns = static_cast<std::uint32_t>(std::max(3.0, triangles / (2.0 * (kRings - 1))));
  Mesh mesh;
  mesh.name = "needles";
  const auto at = [](double polar, double turn) {
    return vec3(
        dvec3(std::sin(polar) * std::cos(turn), std::cos(polar), std::sin(polar) * std::sin(turn)));
  };
  mesh.positions = {vec3(0.0f, 1.0f, 0.0f), vec3(0.0f, -1.0f, 0.0f)};
  for (std::uint32_t ring = 1; ring < kRings; ++ring)
    for (std::uint32_t c = 0; c < columns; ++c)
      mesh.positions.push_back(
          at(3.141592653589793 * ring / kRings, 6.283185307179586 * c / columns));
  const auto vertex = [&](std::uint32_t ring, std::uint32_t c) {
    return 2 + (ring - 1) * columns + c % columns;
  };
  for (std::uint32_t c = 0; c < columns; ++c) {
    mesh.triangles.push_back({0, vertex(1, c + 1), vertex(1, c)});
    mesh.triangles.push_back({1, vertex(kRings - 1, c), vertex(kRings - 1, c + 1)});
    for (std::uint32_t ring = 1; ring + 1 < kRings; ++ring) {
      mesh.triangles.push_back({vertex(ring, c), vertex(ring, c + 1), vertex(ring + 1, c)});
      mesh.triangles.push_back({vertex(ring, c + 1), vertex(ring + 1, c + 1), vertex(ring + 1, c)});
    }
  }
  return mesh;
}

/// A square of hills with noise of eight octaves.
inline Mesh terrainMesh(double triangles) {
  const int n = std::max(1, static_cast<int>(std::lround(std::sqrt(triangles / 2.0))));
  Mesh mesh;
  mesh.name = "terrain";
  const auto lattice = [](int octave, std::int64_t i, std::int64_t j) {
    return uniform(mix(static_cast<std::uint64_t>(octave) << 56 ^
                       static_cast<std::uint64_t>(i) << 28 ^ static_cast<std::uint64_t>(j)));
  };
  const auto height = [&](double x, double y) {
    double h = 0.0, size = 0.12, cells = 6.0;
    for (int octave = 0; octave < 11; ++octave, size *= 0.5, cells *= 2.0) {
      const double u = x * cells, v = y * cells;
      const auto i = static_cast<std::int64_t>(u), j = static_cast<std::int64_t>(v);
      const auto smooth = [](double f) { return f * f * (3.0 - 2.0 * f); };
      const double s = smooth(u - double(i)), t = smooth(v - double(j));
      const double low = lattice(octave, i, j) * (1.0 - s) + lattice(octave, i + 1, j) * s;
      const double high = lattice(octave, i, j + 1) * (1.0 - s) + lattice(octave, i + 1, j + 1) * s;
      h += size * (low * (1.0 - t) + high * t);
    }
    return h;
  };
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) {
      const double x = double(i) / n, y = double(j) / n;
      mesh.positions.push_back(vec3(float(x), float(height(x, y)), float(y)));
    }
  const auto row = static_cast<std::uint32_t>(n + 1);
  for (std::uint32_t j = 0; j + 1 < row; ++j)
    for (std::uint32_t i = 0; i + 1 < row; ++i) {
      const std::uint32_t v = j * row + i;
      mesh.triangles.push_back({v, v + row, v + 1});
      mesh.triangles.push_back({v + 1, v + row, v + row + 1});
    }
  return mesh;
}

/// Adds a grid of (rows + 1) x (columns + 1) points; `point(u, v)` with u, v in [0, 1].
template <typename Point>
void addPatch(Mesh& mesh, int rows, int columns, const Point& point) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i)
      mesh.positions.push_back(vec3(point(double(i) / columns, double(j) / rows)));
  const auto width = static_cast<std::uint32_t>(columns + 1);
  for (std::uint32_t j = 0; j < static_cast<std::uint32_t>(rows); ++j)
    for (std::uint32_t i = 0; i + 1 < width; ++i) {
      const std::uint32_t v = first + j * width + i;
      mesh.triangles.push_back({v, v + 1, v + width + 1});
      mesh.triangles.push_back({v, v + width + 1, v + width});
    }
}

/// Parts as of a machine: pipes in rings of long triangles, plates of few triangles, rivets and
/// springs, of sizes from 1 to 1e-3, turned any way, in a box of 2 m.
inline Mesh assemblyMesh(double triangles) {
  Mesh mesh;
  mesh.name = "assembly";
  constexpr double kTurn = 6.283185307179586;
  for (std::uint64_t part = 0; double(mesh.triangles.size()) < triangles; ++part) {
    const std::uint64_t key = part * 64;
    const auto random = [&](std::uint64_t i) { return double(uniform(key + i)); };
    const dvec3 centre(2.0 * random(0) - 1.0, 2.0 * random(1) - 1.0, 2.0 * random(2) - 1.0);
    const double size = 0.3 * std::pow(10.0, -2.2 * random(3));
    const dvec3 z = glm::normalize(dvec3(random(4) - 0.5, random(5) - 0.5, random(6) - 0.497));
    const dvec3 x = glm::normalize(glm::cross(z, dvec3(0.3, 0.8, 0.52))), y = glm::cross(z, x);
    const bool straight = random(7) < 0.6;  // most parts are along the axes
    const auto place = [&](double a, double b, double c) {
      return centre + size * (straight ? dvec3(a, b, c) : a * x + b * y + c * z);
    };
    const auto count = [&](std::uint64_t i, double least, double most) {
      return static_cast<int>(least * std::pow(most / least, random(i)));
    };
    const double kind = random(8);
    if (kind < 0.35) {  // a pipe, bent a little
      const double bend = random(9) < 0.5 ? 0.0 : random(10), radius = 0.03 + 0.1 * random(11);
      addPatch(mesh, count(12, 1.0, 60.0), count(13, 12.0, 64.0), [&](double u, double v) {
        return place(radius * std::cos(kTurn * u) + bend * v * v, radius * std::sin(kTurn * u), v);
      });
    } else if (kind < 0.6) {  // a plate: six sides of few squares
      const int squares = count(12, 1.0, 12.0);
      const double thick = 0.02 + 0.2 * random(9);
      for (int side = 0; side < 6; ++side)
        addPatch(mesh, squares, squares, [&](double u, double v) {
          double c[3];
          c[side % 3] = side < 3 ? 0.0 : 1.0;
          c[(side + 1) % 3] = side < 3 ? v : u;
          c[(side + 2) % 3] = side < 3 ? u : v;
          return place(c[0], c[1], c[2] * thick);
        });
    } else if (kind < 0.85) {  // a rivet
      const int rings = count(12, 4.0, 24.0);
      addPatch(mesh, rings, 2 * rings, [&](double u, double v) {
        const double s = std::sin(0.5 * kTurn * v);
        return place(0.05 * s * std::cos(kTurn * u), 0.05 * s * std::sin(kTurn * u),
                     0.05 * std::cos(0.5 * kTurn * v));
      });
    } else {  // a spring
      const int turns = count(12, 3.0, 20.0);
      addPatch(mesh, 32 * turns, count(13, 6.0, 16.0), [&](double u, double v) {
        const double a = kTurn * turns * v, r = 0.2 + 0.02 * std::cos(kTurn * u);
        return place(r * std::cos(a), r * std::sin(a), v + 0.02 * std::sin(kTurn * u));
      });
    }
  }
  return mesh;
}

/// "sphere", "scan", "needles", "terrain" or "assembly"; an empty mesh for other names.
inline Mesh meshOfKind(const std::string& kind, double triangles) {
  if (kind == "scan") return scanMesh(triangles);
  if (kind == "needles") return needleMesh(triangles);
  if (kind == "terrain") return terrainMesh(triangles);
  if (kind == "assembly") return assemblyMesh(triangles);
  if (kind == "sphere")
    return bumpySphere(std::max(1, static_cast<int>(std::lround(std::sqrt(triangles / 12.0)))),
                       false);
  return {};
}

}  // namespace trex::bench
