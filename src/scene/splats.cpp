#include "src/scene/splats.h"

#include <fmt/format.h>

#include <cmath>

namespace trex::detail {
namespace {

constexpr std::array<glm::uvec3, 2> kSquare = {{{0, 1, 2}, {0, 2, 3}}};
// Corners +x, -x, +y, -y, +z, -z.
constexpr std::array<glm::uvec3, 8> kOctahedron = {
    {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}}};

vec3 unitOrUp(const vec3& n) {
  const float length = glm::length(n);
  return length > 0.0f && std::isfinite(length) ? n / length : vec3(0.0f, 1.0f, 0.0f);
}

}  // namespace

Splats::Splats(double size, bool normals) : size_(size), normals_(normals) {}

std::span<const glm::uvec3> Splats::triangles() const {
  if (normals_) return kSquare;
  return kOctahedron;
}

std::array<vec3, 6> Splats::around(const vec3& normal) const {
  const auto half = static_cast<float>(0.5 * size_);
  std::array<vec3, 6> out;
  if (normals_) {
    const Basis basis(unitOrUp(normal));
    const vec3 u = half * basis.tangent, v = half * basis.bitangent;
    return {-u - v, u - v, u + v, v - u, vec3(0.0f), vec3(0.0f)};
  }
  for (int k = 0; k < 3; ++k) {
    out[2 * k] = out[2 * k + 1] = vec3(0.0f);
    out[2 * k][k] = half;
    out[2 * k + 1][k] = -half;
  }
  return out;
}

std::string Splats::describe(std::uint64_t points, double metres) const {
  return fmt::format("{} points are shown as {} of {} triangles each, {} m across", points,
                     normals_ ? "squares" : "octahedra", triangles().size(), metres);
}

}  // namespace trex::detail
