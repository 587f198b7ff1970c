// A room with boxes and spheres as triangles, for the tests and the benchmark of G-rays.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "asvo/asvo.h"

namespace trex::test {

/// Triangles in memory; each has an albedo of its own.
class Room : public asvo::TriangleSource {
 public:
  std::uint64_t count() const override { return triangles_.size(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override { triangle = triangles_[i]; }
  asvo::Shade shade(const asvo::Triangle& triangle, float, float) const override {
    return {albedos_[triangle.shadeKey], glm::vec3(0.0f), false, triangle.material == metal_};
  }
  /// Surfaces of this material send light by its direction.
  void setMetal(std::uint32_t material) { metal_ = material; }

  void addTriangle(glm::vec3 a, glm::vec3 b, glm::vec3 c, glm::vec3 albedo,
                   std::uint32_t material) {
    asvo::Triangle t;
    t.position[0] = a;
    t.position[1] = b;
    t.position[2] = c;
    t.material = material;
    t.shadeKey = static_cast<std::uint32_t>(albedos_.size());
    triangles_.push_back(t);
    albedos_.push_back(albedo);
  }
  void addQuad(glm::vec3 corner, glm::vec3 u, glm::vec3 v, glm::vec3 albedo,
               std::uint32_t material) {
    addTriangle(corner, corner + u, corner + u + v, albedo, material);
    addTriangle(corner, corner + u + v, corner + v, albedo, material);
  }
  /// Faces outwards; inwards for a room, seen from within.
  void addBox(glm::vec3 lower, glm::vec3 upper, glm::vec3 albedo, bool inwards = false,
              std::uint32_t material = 0) {
    for (int axis = 0; axis < 3; ++axis) {
      glm::vec3 u(0.0f), v(0.0f);
      const int a = (axis + 1) % 3, b = (axis + 2) % 3;
      u[a] = upper[a] - lower[a];
      v[b] = upper[b] - lower[b];
      glm::vec3 far = lower;
      far[axis] = upper[axis];
      // u x v points to +axis.
      inwards ? addQuad(lower, u, v, albedo, material) : addQuad(lower, v, u, albedo, material);
      inwards ? addQuad(far, v, u, albedo, material) : addQuad(far, u, v, albedo, material);
    }
  }
  void addSphere(glm::vec3 centre, float radius, glm::vec3 albedo, std::uint32_t material = 0) {
    constexpr int kRows = 24, kColumns = 48;
    const auto point = [&](int row, int column) {
      const float theta = 3.14159265f * static_cast<float>(row) / kRows;
      const float phi = 6.2831853f * static_cast<float>(column) / kColumns;
      return centre + radius * glm::vec3(std::sin(theta) * std::cos(phi), std::cos(theta),
                                         std::sin(theta) * std::sin(phi));
    };
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        const glm::vec3 a = point(row, column), b = point(row, column + 1);
        const glm::vec3 c = point(row + 1, column + 1), d = point(row + 1, column);
        if (row > 0) addTriangle(a, b, c, albedo, material);
        if (row < kRows - 1) addTriangle(a, c, d, albedo, material);
      }
    }
  }

 private:
  std::vector<asvo::Triangle> triangles_;
  std::vector<glm::vec3> albedos_;
  std::uint32_t metal_ = 0xffffffffu;
};

/// 4 x 3 x 5 m, coloured walls, three boxes and two spheres.
inline Room furnishedRoom() {
  Room room;
  room.addBox({0, 0, 0}, {4, 3, 5}, {0.7f, 0.7f, 0.7f}, true);
  room.addBox({0.4f, 0, 0.5f}, {1.2f, 1.4f, 1.3f}, {0.7f, 0.2f, 0.1f});
  room.addBox({2.5f, 0, 2.0f}, {3.6f, 0.8f, 3.4f}, {0.2f, 0.6f, 0.2f});
  room.addBox({1.0f, 0, 3.8f}, {1.5f, 2.0f, 4.3f}, {0.3f, 0.3f, 0.8f});
  room.addSphere({3.0f, 1.3f, 2.7f}, 0.45f, {0.8f, 0.8f, 0.3f});
  room.addSphere({1.6f, 0.5f, 2.4f}, 0.5f, {0.5f, 0.5f, 0.5f});
  return room;
}

/// A generator for test data: 24-bit numbers in [0, 1) [PCG, O'Neill 2014].
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 2 + 1) { next(); }
  float next() {
    state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
    const auto shifted = static_cast<std::uint32_t>(((state_ >> 18) ^ state_) >> 27);
    const auto turn = static_cast<std::uint32_t>(state_ >> 59);
    const std::uint32_t bits = (shifted >> turn) | (shifted << ((32u - turn) & 31u));
    return static_cast<float>(bits >> 8) * 0x1p-24f;
  }
  glm::vec3 direction() {
    const float z = 1.0f - 2.0f * next();
    const float r = std::sqrt(std::max(0.0f, 1.0f - z * z));
    const float phi = 6.2831853f * next();
    return {r * std::cos(phi), r * std::sin(phi), z};
  }
  glm::vec3 inside(glm::vec3 lower, glm::vec3 upper) {
    const float x = next(), y = next(), z = next();
    return lower + (upper - lower) * glm::vec3(x, y, z);
  }

 private:
  std::uint64_t state_;
};

}  // namespace trex::test
