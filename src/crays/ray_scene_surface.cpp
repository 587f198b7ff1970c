#include "src/crays/ray_scene_surface.h"

#include <algorithm>
#include <cmath>

namespace trex {
namespace {

// Unit, or zero where the length is zero or not a number.
dvec3 unitOrZero(const dvec3& v) {
  const double length2 = glm::dot(v, v);
  if (length2 > 1e-200 && length2 < 1e200) return v * (1.0 / std::sqrt(length2));
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

// [Hanika 2021]: the point as seen from the tangent planes of the corners, by its weights. `sign`
// turns normals to the triangle's front.
void liftOff(const hccm::Triangle& triangle, const Placement& placement, const dvec3 (&p)[3],
             const dvec3& weights, const dvec3& normal, double sign, Surface& s) {
  // Corners that look elsewhere speak of no smooth surface.
  constexpr double kLeastCosine = 0.3;
  dvec3 lift[2] = {dvec3(0.0), dvec3(0.0)};
  double least = 1.0;
  for (int i = 0; i < 3; ++i) {
    const dvec3 n = sign * unitOrZero(placement.normalMatrix * dvec3(triangle.normal[i]));
    least = std::min(least, glm::dot(n, normal));
    const double height = glm::dot(s.position - p[i], n);
    lift[height < 0.0 ? 0 : 1] -= weights[i] * height * n;
  }
  if (!(least > kLeastCosine) || least > 1.0 - 1e-9) return;
  s.lift[0] = vec3(lift[0]), s.lift[1] = vec3(lift[1]);
  s.bend = static_cast<float>(std::sqrt(1.0 - least * least));
}

}  // namespace

bool Placement::make(const dmat4& transform, int object, Placement& out) {
  out.toRender = transform;
  out.moved = transform != dmat4(1.0);
  out.object = object;
  const glm::dmat3 linear(out.toRender);
  const double determinant = glm::determinant(linear);
  const double norm = normOf(linear);
  if (!std::isfinite(norm) || !isFinite(vec3(out.toRender[3]))) return false;
  // Flatter than this, single precision, by which Embree culls, has no inverse left.
  if (!(std::abs(determinant) > 1e-9 * norm * norm * norm) || !(norm > 1e-15)) return false;
  const glm::dmat3 inverse = glm::inverse(linear);
  out.toMesh = dmat4(inverse);
  out.toMesh[3] = glm::dvec4(-(inverse * dvec3(out.toRender[3])), 1.0);
  out.mirrored = determinant < 0.0;
  out.normalMatrix = glm::transpose(inverse);
  out.far = largestOf(dvec3(out.toRender[3]));
  out.slack = 0x1p-49 * normOf(inverse) * norm * normOf(inverse);
  out.embreeSlack = 0x1p30 * out.slack;
  return true;
}

hccm::Ray Placement::rayToMesh(const RayStart& start, const vec3& direction, float tnear,
                               float tfar, const RayEnd& end, double step) const {
  const auto place = [&](const dvec3& p) { return moved ? dvec3(toMesh * glm::dvec4(p, 1.0)) : p; };
  hccm::Ray ray{.origin = place(start.position),
                .tnear = tnear,
                .direction = moved ? vec3(glm::dmat3(toMesh) * dvec3(direction)) : direction,
                .tfar = tfar,
                .fromCluster = start.from.cluster,
                .fromTriangle = start.from.triangle,
                .toCluster = end.on.cluster,
                .toTriangle = end.on.triangle};
  // What is rounded to the grid moves a plane by no more than a cell and a half.
  const double rounded = slack * (largestOf(start.position) + far);
  if (start.on == RayStart::On::kSurface) ray.slack = rounded;
  if (start.on == RayStart::On::kSource) ray.slack = rounded + 1.5 * step;
  if (end.point) {
    ray.target = place(*end.point);
    ray.targetSlack = slack * (largestOf(*end.point) + far) + 1.5 * step;
  }
  return ray;
}

void readAttributes(const hccm::Triangle& triangle, const RayHit& hit, Surface& s) {
  const vec3 weights(1.0 - hit.u - hit.v, hit.u, hit.v);
  const auto mix = [&](const vec2(&uv)[3]) {
    return weights.x * uv[0] + weights.y * uv[1] + weights.z * uv[2];
  };
  s.texCoords[0] = mix(triangle.texCoord);
  s.texCoords[1] = triangle.hasSecondTexCoords ? mix(triangle.secondTexCoord) : vec2(0.0f);
  s.color = vec4(1.0f);
  if (triangle.hasColors) {
    s.color = weights.x * unpackVertexColor(triangle.color[0]) +
              weights.y * unpackVertexColor(triangle.color[1]) +
              weights.z * unpackVertexColor(triangle.color[2]);
  }
}

Surface makeSurface(const hccm::Triangle& triangle, const Placement& placement, const RayHit& hit) {
  Surface s{};
  s.instance = hit.instance, s.cluster = hit.cluster, s.triangle = hit.triangle;
  dvec3 p[3];
  for (int i = 0; i < 3; ++i) {
    p[i] = dvec3(triangle.position[i]);
    if (placement.moved) p[i] = dvec3(placement.toRender * glm::dvec4(p[i], 1.0));
  }
  const double u = hit.u, v = hit.v, w = 1.0 - u - v;
  const dvec3 e1 = p[1] - p[0], e2 = p[2] - p[0];
  s.position = p[0] + u * e1 + v * e2;

  dvec3 shading(0.0);
  if (triangle.hasNormals)
    shading = unitOrZero(placement.normalMatrix *
                         (w * dvec3(triangle.normal[0]) + u * dvec3(triangle.normal[1]) +
                          v * dvec3(triangle.normal[2])));
  dvec3 normal = unitOrZero(placement.mirrored ? glm::cross(e2, e1) : glm::cross(e1, e2));
  if (isZero(normal)) normal = normalOfLine(e1, e2, shading);
  if (isZero(shading)) shading = normal;
  const double side = glm::dot(shading, normal) < 0.0 ? -1.0 : 1.0;
  shading *= side;
  if (triangle.hasNormals) liftOff(triangle, placement, p, dvec3(w, u, v), normal, side, s);
  s.geometricNormal = vec3(normal);
  s.shadingNormal = vec3(shading);

  readAttributes(triangle, hit, s);
  if (triangle.hasTexCoords) tangents(e1, e2, triangle, shading, s);
  s.material = triangle.material;
  s.object =
      placement.object != kNone ? static_cast<std::uint32_t>(placement.object) : triangle.object;
  return s;
}

}  // namespace trex
