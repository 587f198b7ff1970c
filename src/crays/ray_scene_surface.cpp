#include "src/crays/ray_scene_surface.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

// Unit, or zero where the length is zero or not a number.
dvec3 unitOrZero(const dvec3& v) {
  const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
  if (!(largest > 0.0) || !std::isfinite(largest)) return dvec3(0.0);
  return glm::normalize(v / largest);
}

bool isZero(const dvec3& v) { return v == dvec3(0.0); }

// Of all directions across a triangle without area, one that is good enough to shade with.
dvec3 normalOfLine(const dvec3& e1, const dvec3& e2, const dvec3& hint) {
  const dvec3 along = unitOrZero(glm::dot(e1, e1) > glm::dot(e2, e2) ? e1 : e2);
  if (isZero(along)) return isZero(hint) ? dvec3(0.0, 0.0, 1.0) : hint;
  const dvec3 across = unitOrZero(hint - glm::dot(hint, along) * along);
  if (!isZero(across)) return across;
  const dvec3 size = glm::abs(along);
  dvec3 least(0.0);
  least[size.x < size.y ? (size.x < size.z ? 0 : 2) : (size.y < size.z ? 1 : 2)] = 1.0;
  return unitOrZero(glm::cross(along, least));
}

// dP/du and -dP/dv by the triangle's texture coordinates, made orthonormal to n.
void tangents(const dvec3& e1, const dvec3& e2, const hccm::Triangle& t, const dvec3& n,
              Surface& s) {
  const glm::dvec2 d1(t.texCoord[1] - t.texCoord[0]), d2(t.texCoord[2] - t.texCoord[0]);
  const double determinant = d1.x * d2.y - d1.y * d2.x;
  if (determinant == 0.0 || !std::isfinite(determinant)) return;
  const double sign = determinant < 0.0 ? -1.0 : 1.0;  // lengths do not matter
  const dvec3 alongU = (e1 * d2.y - e2 * d1.y) * sign, alongV = (e2 * d1.x - e1 * d2.x) * sign;
  const dvec3 tangent = unitOrZero(alongU - glm::dot(alongU, n) * n);
  if (isZero(tangent)) return;
  const dvec3 side = glm::cross(n, tangent);
  s.tangent = vec3(tangent);
  s.bitangent = vec3(glm::dot(side, alongV) <= 0.0 ? side : -side);  // up in the texture is -v
}

double largestOf(const dvec3& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

// The largest sum of a row's sizes.
double normOf(const glm::dmat3& m) {
  double norm = 0.0;
  for (int row = 0; row < 3; ++row)
    norm = std::max(norm, std::abs(m[0][row]) + std::abs(m[1][row]) + std::abs(m[2][row]));
  return norm;
}

}  // namespace

bool Placement::make(const dmat4& transform, double step, int object, Placement& out) {
  out.toRender = dmat4(mat4(transform));
  out.object = object;
  const glm::dmat3 linear(out.toRender);
  const double determinant = glm::determinant(linear);
  const double norm = normOf(linear);
  if (!std::isfinite(norm) || !isFinite(vec3(out.toRender[3]))) return false;
  // Flatter than this, single precision has no inverse left.
  if (!(std::abs(determinant) > 1e-9 * norm * norm * norm) || !(norm > 1e-15)) return false;
  const glm::dmat3 inverse = glm::inverse(linear);
  out.mirrored = determinant < 0.0;
  out.normalMatrix = glm::transpose(inverse);
  // Embree rounds a ray's way to mesh space: a few ulps of all that is added up, in mesh space,
  // seen from here.
  const double condition = norm * normOf(inverse);
  out.relativeError = 0x1p-20 * (1.0 + condition);
  out.error = 2.0 * step * norm + 0x1p-20 * condition * largestOf(dvec3(out.toRender[3]));
  return true;
}

Surface makeSurface(const hccm::Triangle& triangle, const Placement& placement, float u, float v) {
  Surface s{};
  dvec3 p[3];
  for (int i = 0; i < 3; ++i)
    p[i] = dvec3(placement.toRender * glm::dvec4(dvec3(triangle.position[i]), 1.0));
  const double w = 1.0 - double(u) - double(v);
  const dvec3 e1 = p[1] - p[0], e2 = p[2] - p[0];
  const dvec3 position = p[0] + double(u) * e1 + double(v) * e2;
  s.position = vec3(position);

  dvec3 shading(0.0);
  if (triangle.hasNormals)
    shading = unitOrZero(placement.normalMatrix *
                         (w * dvec3(triangle.normal[0]) + double(u) * dvec3(triangle.normal[1]) +
                          double(v) * dvec3(triangle.normal[2])));
  dvec3 normal = unitOrZero(placement.mirrored ? glm::cross(e2, e1) : glm::cross(e1, e2));
  if (isZero(normal)) normal = normalOfLine(e1, e2, shading);
  if (isZero(shading)) shading = normal;
  if (glm::dot(shading, normal) < 0.0) shading = -shading;
  s.geometricNormal = vec3(normal);
  s.shadingNormal = vec3(shading);

  s.texCoord =
      float(w) * triangle.texCoord[0] + u * triangle.texCoord[1] + v * triangle.texCoord[2];
  if (triangle.hasTexCoords) tangents(e1, e2, triangle, shading, s);
  s.color = float(w) * triangle.color[0] + u * triangle.color[1] + v * triangle.color[2];
  s.material = triangle.material;
  s.object = placement.object >= 0 ? static_cast<std::uint32_t>(placement.object) : triangle.object;
  s.error = static_cast<float>(placement.error +
                               placement.relativeError *
                                   (largestOf(position) + largestOf(e1) + largestOf(e2)));
  return s;
}

}  // namespace trex
