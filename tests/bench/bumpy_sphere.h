// A smooth, bumpy, closed surface of any number of triangles, for figures and crack tests.
#pragma once

#include <cmath>
#include <cstdint>

#include "src/scene/scene.h"

namespace trex::bench {

/// A cube of n x n squares a side, blown up to a sphere of radius about 1 and rippled. A point
/// depends on its place on the cube alone, so that edges of the cube's sides fit to the bit. 12 n^2
/// triangles, counter-clockwise seen from outside.
inline Mesh bumpySphere(int n, bool normals) {
  Mesh mesh;
  mesh.name = "bumpy sphere";
  const auto point = [n](int a, int b, int c) {
    const auto warp = [n](int i) { return std::tan(double(i) / n * 0.7853981633974483); };
    const dvec3 d = glm::normalize(dvec3(warp(a), warp(b), warp(c)));
    double r =
        1.0 + 0.08 * std::sin(5.0 * d.x + 1.0) * std::sin(6.0 * d.y) * std::sin(4.0 * d.z + 2.0);
    r += 0.015 * std::sin(23.0 * d.x) * std::sin(29.0 * d.y + 0.5) * std::sin(31.0 * d.z);
    r += 0.002 * std::sin(101.0 * d.x) * std::sin(97.0 * d.y) * std::sin(89.0 * d.z);
    return vec3(d * r);
  };
  for (int side = 0; side < 6; ++side) {
    const int axis = side / 2, sign = side % 2 == 0 ? 1 : -1;
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) {
        int at[3];
        at[axis] = sign * n;
        at[(axis + 1) % 3] = 2 * i - n;
        at[(axis + 2) % 3] = sign * (2 * j - n);
        mesh.positions.push_back(point(at[0], at[1], at[2]));
      }
    const auto row = static_cast<std::uint32_t>(n + 1);
    for (std::uint32_t j = 0; j + 1 < row; ++j)
      for (std::uint32_t i = 0; i + 1 < row; ++i) {
        const std::uint32_t v = first + j * row + i;
        mesh.triangles.push_back({v, v + 1, v + row + 1});
        mesh.triangles.push_back({v, v + row + 1, v + row});
      }
  }
  if (normals)
    for (const vec3& p : mesh.positions) mesh.normals.push_back(glm::normalize(p));
  return mesh;
}

inline Scene sceneOf(Mesh mesh) {
  Scene scene;
  scene.source = "synth";
  scene.materials.emplace_back();
  scene.meshes.push_back(std::move(mesh));
  scene.instances.emplace_back();
  scene.objects.push_back("object");
  return scene;
}

/// splitmix64 [Steele et al. 2014]; random bits from a counter.
inline std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ull;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}
/// In [0, 1).
inline float uniform(std::uint64_t key) { return static_cast<float>(mix(key) >> 40) * 0x1p-24f; }

}  // namespace trex::bench
