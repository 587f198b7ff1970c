#include "src/scene/shape_meshes.h"

#include <gtest/gtest.h>

#include <functional>

namespace trex::detail {
namespace {

constexpr double kTau = 2.0 * std::numbers::pi;

double areaOf(const Mesh& mesh) {
  double area = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    area += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return area;
}

/// Largest distance of points of the triangles from a surface.
double worst(const Mesh& mesh, const std::function<double(const dvec3&)>& distance) {
  double most = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    for (int i = 0; i <= 4; ++i) {
      for (int j = 0; i + j <= 4; ++j) {
        most = std::max(most, std::abs(distance(a + (b - a) * (i / 4.0) + (c - a) * (j / 4.0))));
      }
    }
  }
  return most;
}

/// Faces turn the way their normals point, normals are unit, and uv is in [0, 1].
void expectSound(const Mesh& mesh) {
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  ASSERT_EQ(mesh.texCoords.size(), mesh.positions.size());
  for (const glm::uvec3& t : mesh.triangles) {
    ASSERT_LT(std::max({t.x, t.y, t.z}), mesh.positions.size());
    const vec3 a = mesh.positions[t.x];
    const vec3 face = glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a);
    EXPECT_GT(glm::length(face), 0.0f);
    for (int k = 0; k < 3; ++k) {
      EXPECT_GT(glm::dot(face, mesh.normals[t[k]]), 0.0f);
      EXPECT_NEAR(glm::length(mesh.normals[t[k]]), 1.0f, 1e-6f);
    }
  }
  for (const vec2& uv : mesh.texCoords) {
    EXPECT_TRUE(uv.x >= 0.0f && uv.x <= 1.0f && uv.y >= 0.0f && uv.y <= 1.0f);
  }
}

TEST(ShapeMeshes, SphereHasItsAreaAndKeepsWithinItsError) {
  for (const double error : {0.02, 2e-3, kShapeError}) {
    const Mesh mesh = sphereMesh({.radius = 3.0}, error);
    expectSound(mesh);
    EXPECT_NEAR(areaOf(mesh), 2.0 * kTau * 9.0, 1e-4);
    EXPECT_LE(worst(mesh, [](const dvec3& p) { return glm::length(p) / 3.0 - 1.0; }), error);
  }
}

TEST(ShapeMeshes, SphereHasItsPolesOnZAndUFromXToY) {
  const Mesh mesh = sphereMesh();
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const vec3 n = mesh.normals[i];
    const vec2 uv = mesh.texCoords[i];
    EXPECT_NEAR(n.z, -std::cos(uv.y * kPi), 1e-6f);
    EXPECT_NEAR(n.y, std::sin(uv.x * 2.0f * kPi) * std::sin(uv.y * kPi), 1e-5f);
  }
}

TEST(ShapeMeshes, PartsOfASphereHaveTheAreaOfTheirZone) {
  const Mesh mesh = sphereMesh({.radius = 2.0, .zMin = -0.5, .zMax = 1.0, .phiMax = kTau / 4});
  expectSound(mesh);
  EXPECT_NEAR(areaOf(mesh), kTau / 4 * 2.0 * 1.5, 1e-5);
  Box3f box;
  for (const vec3& p : mesh.positions) box.extend(p);
  EXPECT_NEAR(box.lower.z, -0.5f, 1e-3f);
  EXPECT_NEAR(box.upper.z, 1.0f, 1e-3f);
  EXPECT_NEAR(box.lower.x, 0.0f, 1e-6f);
}

TEST(ShapeMeshes, CylinderAndDiskHaveTheirAreas) {
  const Mesh tube = cylinderMesh({.radius = 0.5, .zMin = -1.0, .zMax = 2.0});
  expectSound(tube);
  EXPECT_NEAR(areaOf(tube), kTau * 0.5 * 3.0, 1e-5);
  EXPECT_LE(worst(tube, [](const dvec3& p) { return glm::length(glm::dvec2(p)) / 0.5 - 1.0; }),
            kShapeError);
  const Mesh disk = diskMesh(2.0, 1.0, 4.0, kTau / 2);
  expectSound(disk);
  EXPECT_NEAR(areaOf(disk), kTau / 4 * 3.0, 1e-5);
  for (const vec3& p : disk.positions) EXPECT_EQ(p.z, 4.0f);
  EXPECT_NEAR(areaOf(diskMesh()), kTau / 2, 1e-5);
}

TEST(ShapeMeshes, RectangleAndCube) {
  expectSound(rectangleMesh());
  EXPECT_DOUBLE_EQ(areaOf(rectangleMesh()), 4.0);
  const Mesh cube = cubeMesh();
  expectSound(cube);
  EXPECT_DOUBLE_EQ(areaOf(cube), 24.0);
  // Faces away from the middle are outside.
  for (std::size_t i = 0; i < cube.positions.size(); ++i) {
    EXPECT_EQ(glm::dot(cube.positions[i], cube.normals[i]), 1.0f);
  }
}

TEST(ShapeMeshes, NumbersOutOfRangeGiveBoundedMeshes) {
  const double nan = std::nan("");
  for (const double odd : {0.0, -1.0, 1e30, nan}) {
    EXPECT_LT(
        sphereMesh({.radius = 1.0, .zMin = odd, .zMax = -odd, .phiMax = odd}).triangles.size(),
        100'000u);
    EXPECT_LT(diskMesh(1.0, odd, 0.0, odd, odd).triangles.size(), 100'000u);
    EXPECT_LT(cylinderMesh({1.0, odd, odd, odd}, odd).triangles.size(), 100'000u);
  }
}

}  // namespace
}  // namespace trex::detail
