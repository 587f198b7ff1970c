// Small meshes for the tests of HCCMesh.
#pragma once

#include <random>
#include <vector>

#include "hccmesh/hccmesh.h"

namespace hccm::test {

struct Soup {
  std::vector<glm::vec3> positions;
  std::vector<glm::uvec3> triangles;
  std::vector<glm::vec3> normals;
  std::vector<glm::vec2> texCoords, secondTexCoords;
  std::vector<glm::u8vec4> colors;
  Part part() const {
    Part p;
    p.positions = positions, p.triangles = triangles, p.normals = normals;
    p.texCoords = texCoords, p.colors = colors, p.secondTexCoords = secondTexCoords;
    return p;
  }
};

inline glm::vec3 randomPoint(std::mt19937& random, float extent) {
  std::uniform_real_distribution<float> u(-extent, extent);
  const float x = u(random), y = u(random), z = u(random);
  return {x, y, z};
}

/// Unconnected triangles of sizes from 1 to 1e-3 of the extent, all attributes.
inline Soup randomSoup(int count, float extent, unsigned seed) {
  std::mt19937 random(seed);
  Soup s;
  for (int i = 0; i < count; ++i) {
    const glm::vec3 centre = randomPoint(random, extent);
    const float size = extent * std::pow(10.0f, -static_cast<float>(random() % 3000) / 1000.0f);
    for (int k = 0; k < 3; ++k) {
      s.positions.push_back(centre + randomPoint(random, size));
      s.normals.push_back(glm::normalize(randomPoint(random, 1.0f) + glm::vec3(0.0f, 0.0f, 1e-3f)));
      s.texCoords.push_back(glm::vec2(randomPoint(random, i % 2 ? 0.4f : 50.0f)));
      s.colors.push_back(
          glm::u8vec4(random() % 256, random() % 256, random() % 256, random() % 256));
    }
    const auto v = static_cast<std::uint32_t>(3 * i);
    s.triangles.push_back({v, v + 1, v + 2});
  }
  return s;
}

/// With second texture coordinates that are the positions, scaled.
inline Soup withSecondSet(Soup s, float scale) {
  s.secondTexCoords.clear();
  for (const glm::vec3& p : s.positions) s.secondTexCoords.push_back(scale * glm::vec2(p.y, p.x));
  return s;
}

/// A wavy sheet of 2 n^2 connected triangles.
inline Soup sheet(int n, float extent = 1.0f) {
  Soup s;
  const auto row = static_cast<std::uint32_t>(n + 1);
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) {
      const float x = static_cast<float>(i) / static_cast<float>(n) - 0.5f;
      const float y = static_cast<float>(j) / static_cast<float>(n) - 0.5f;
      s.positions.push_back(extent *
                            glm::vec3(x, y, 0.1f * std::sin(9.0f * x) * std::cos(7.0f * y)));
    }
  for (std::uint32_t j = 0; j + 1 < row; ++j)
    for (std::uint32_t i = 0; i + 1 < row; ++i) {
      const std::uint32_t v = j * row + i;
      s.triangles.push_back({v, v + 1, v + row + 1});
      s.triangles.push_back({v, v + row + 1, v + row});
    }
  return s;
}

/// All triangles of a cluster by their numbers, which have gaps.
template <typename Visit>
void forEachTriangle(const Mesh& mesh, std::uint32_t cluster, const Visit& visit) {
  for (std::uint32_t leaf = 0; leaf < mesh.clusterLeafCount(cluster); ++leaf)
    for (std::uint32_t i = 0; i < mesh.leafTriangleCount(cluster, leaf); ++i) visit(8 * leaf + i);
}

inline Mesh build(const Soup& soup, const BuildOptions& options = {}) {
  const Part part = soup.part();
  return Mesh::build({&part, 1}, options);
}

}  // namespace hccm::test
