// Triangle sources for the tests and the benchmark of asvo/.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <numbers>
#include <random>
#include <vector>

#include "asvo/asvo.h"

namespace asvo_shapes {

using glm::mat3;
using glm::vec3;

/// Triangles in memory with one shade.
class Shape : public asvo::TriangleSource {
 public:
  std::vector<asvo::Triangle> triangles;
  asvo::Shade constant{vec3(0.5f), vec3(0.0f), false};

  std::uint64_t count() const override { return triangles.size(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override { triangle = triangles[i]; }
  asvo::Shade shade(const asvo::Triangle&, float, float) const override { return constant; }

  void add(const vec3& a, const vec3& b, const vec3& c, std::uint32_t material = 0) {
    triangles.push_back({{a, b, c}, material, 0});
  }
  void addQuad(const vec3& a, const vec3& b, const vec3& c, const vec3& d,
               std::uint32_t material = 0) {
    add(a, b, c, material);
    add(a, c, d, material);
  }
  /// Faces outwards.
  void addBox(const vec3& lower, const vec3& upper, const mat3& rotation = mat3(1.0f),
              std::uint32_t material = 0) {
    auto corner = [&](int i) {
      return rotation *
             vec3(i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y, i & 4 ? upper.z : lower.z);
    };
    constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                  {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    for (const auto& f : kFaces) {
      addQuad(corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]), material);
    }
  }
  void addSphere(const vec3& centre, float radius, int rings) {
    auto point = [&](int i, int j) {
      const float theta =
          std::numbers::pi_v<float> * static_cast<float>(i) / static_cast<float>(rings);
      const float phi = std::numbers::pi_v<float> * static_cast<float>(j % (2 * rings)) /
                        static_cast<float>(rings);
      const float s = i == 0 || i == rings ? 0.0f : std::sin(theta);
      return centre + radius * vec3(s * std::cos(phi), s * std::sin(phi), std::cos(theta));
    };
    for (int i = 0; i < rings; ++i) {
      for (int j = 0; j < 2 * rings; ++j) {
        if (i > 0) add(point(i, j), point(i + 1, j), point(i, j + 1));
        if (i < rings - 1) add(point(i, j + 1), point(i + 1, j), point(i + 1, j + 1));
      }
    }
  }
  double area() const {
    double sum = 0.0;
    for (const auto& t : triangles) {
      const glm::dvec3 a(t.position[0]), b(t.position[1]), c(t.position[2]);
      sum += 0.5 * glm::length(glm::cross(b - a, c - a));
    }
    return sum;
  }
};

inline mat3 rotationOf(float degrees, const vec3& axis) {
  return mat3(glm::rotate(glm::mat4(1.0f), glm::radians(degrees), glm::normalize(axis)));
}

/// Random numbers with the same stream on every machine.
class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  float uniform() { return static_cast<float>(engine_() >> 8) * 0x1p-24f; }
  float uniform(float low, float high) { return low + (high - low) * uniform(); }
  vec3 point(float low, float high) {
    const float x = uniform(low, high);
    const float y = uniform(low, high);
    return {x, y, uniform(low, high)};
  }
  vec3 direction() {
    const float z = uniform(-1.0f, 1.0f);
    const float phi = uniform(0.0f, 2.0f * std::numbers::pi_v<float>);
    const float s = std::sqrt(std::max(0.0f, 1.0f - z * z));
    return {s * std::cos(phi), s * std::sin(phi), z};
  }

 private:
  std::mt19937 engine_;
};

/// Five walls, floor and two blocks, 32 triangles: the small scene whose build time is seen most.
inline Shape cornellBox() {
  Shape shape;
  shape.addQuad({-1, -1, 1}, {1, -1, 1}, {1, -1, -1}, {-1, -1, -1});
  shape.addQuad({-1, 1, -1}, {1, 1, -1}, {1, 1, 1}, {-1, 1, 1});
  shape.addQuad({-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1});
  shape.addQuad({-1, -1, 1}, {-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}, 1);
  shape.addQuad({1, -1, -1}, {1, -1, 1}, {1, 1, 1}, {1, 1, -1}, 2);
  shape.addBox({-0.3f, -1.0f, -0.3f}, {0.3f, -0.4f, 0.3f}, rotationOf(17.0f, {0, 1, 0}));
  shape.addBox({-0.6f, -1.0f, -0.6f}, {-0.1f, 0.2f, -0.1f}, rotationOf(-20.0f, {0, 1, 0}));
  return shape;
}

/// Irradiance of one value on both sides of every voxel.
inline std::vector<asvo::uvec4> constantLight(const asvo::Tree& tree, std::uint32_t packed) {
  return std::vector<asvo::uvec4>(tree.nodes.size(), asvo::uvec4(packed));
}

}  // namespace asvo_shapes
