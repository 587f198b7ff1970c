// A leaf from the triangles that touch it: mask, exact areas, averages, plane.
#include <algorithm>
#include <array>
#include <cmath>

#include "asvo/build_parts.h"
#include "asvo/polygon.h"

namespace asvo {
namespace {

constexpr std::size_t kMaxPieces = 4096;
/// Weight of a triangle that touches a leaf without area in it, in leaf faces: it gives the leaf
/// its albedo and normal if nothing else does.
constexpr float kTrifle = 1e-20f;

/// A triangle around `centre`.
Polygon placed(const GridTriangle& triangle, const glm::dvec3& centre) {
  Polygon polygon;
  polygon.count = 3;
  for (int i = 0; i < 3; ++i) polygon.corner[i] = glm::vec3(triangle.vertex[i] - centre);
  return polygon;
}

/// Its part inside the box of half edge `half` on each axis.
Polygon clipTriangle(const GridTriangle& triangle, const glm::dvec3& centre,
                     const glm::vec3& half) {
  Polygon polygon = placed(triangle, centre);
  const glm::vec3 middle(centre);
  constexpr float kHalf = 0.5f * kSubVoxels;
  clipToBox(polygon, half, glm::lessThan(triangle.lower, middle - kHalf),
            glm::greaterThan(triangle.upper, middle + kHalf));
  return polygon;
}

glm::vec3 sane(const glm::vec3& v, float limit) {
  auto one = [limit](float x) { return x > 0.0f ? std::min(x, limit) : 0.0f; };  // NaN becomes 0
  return {one(v.x), one(v.y), one(v.z)};
}

Shade shadeAt(const TriangleSource& source, const Triangle& triangle, double u, double v) {
  Shade shade = source.shade(triangle, static_cast<float>(u), static_cast<float>(v));
  shade.albedo = sane(shade.albedo, 1.0f);
  shade.emission = sane(shade.emission, 1e30f);
  return shade;
}

/// At a point on the grid, by its weights in the triangle.
Shade shadeAt(const TriangleSource& source, const GridTriangle& triangle, const glm::dvec3& point) {
  const glm::dvec3 e1 = triangle.vertex[1] - triangle.vertex[0];
  const glm::dvec3 e2 = triangle.vertex[2] - triangle.vertex[0];
  const glm::dvec3 p = point - triangle.vertex[0];
  const double d11 = glm::dot(e1, e1), d12 = glm::dot(e1, e2), d22 = glm::dot(e2, e2);
  const double p1 = glm::dot(p, e1), p2 = glm::dot(p, e2);
  const double determinant = d11 * d22 - d12 * d12;
  double u = 1.0 / 3.0, v = 1.0 / 3.0;
  if (determinant > 0.0) {
    u = std::clamp((d22 * p1 - d12 * p2) / determinant, 0.0, 1.0);
    v = std::clamp((d11 * p2 - d12 * p1) / determinant, 0.0, 1.0 - u);
  }
  return shadeAt(source, triangle.source, u, v);
}

/// Area-weighted normal, pointing to the side that has more faces.
glm::vec3 alignedNormal(std::span<const LeafBuilder::Piece> pieces) {
  NormalSum sum;
  for (const auto& piece : pieces) sum.add(piece.normal, piece.weight, 0.0f);
  const glm::vec3 normal = sum.normal();
  float along = 0.0f;
  for (const auto& piece : pieces) {
    along += glm::dot(piece.normal, normal) >= 0.0f ? piece.weight : -piece.weight;
  }
  return along < 0.0f ? -normal : normal;
}

}  // namespace

std::optional<Shade> uniformShade(const TriangleSource& source, const Triangle& triangle) {
  if (!source.uniform(triangle)) return {};
  return shadeAt(source, triangle, 1.0 / 3.0, 1.0 / 3.0);
}

const Tracer& packer() {
  static const Tree empty;
  static const Tracer tracer(empty);
  return tracer;
}

float ditherOf(std::uint64_t key) {
  key = (key ^ key >> 31) * 0x9e3779b97f4a7c15ull;
  key = (key ^ key >> 29) * 0xbf58476d1ce4e5b9ull;
  return static_cast<float>(key >> 40) * 0x1p-24f;
}

void NormalSum::add(const glm::vec3& normal, float along, float against) {
  total_ += along + against;
  plain_ += (along - against) * normal;
  const glm::vec3 n = (along + against) * normal;
  extent_ += glm::abs(n);
  for (int axis = 0; axis < 3; ++axis) aligned_[axis] += n[axis] < 0.0f ? -n : n;
  last_ = normal;
}

glm::vec3 NormalSum::normal() const {
  const int axis = extent_.x >= extent_.y && extent_.x >= extent_.z ? 0
                   : extent_.y >= extent_.z                         ? 1
                                                                    : 2;
  const glm::vec3 sum = glm::length(plain_) >= 0.4f * total_ ? plain_ : aligned_[axis];
  const float length = glm::length(sum);
  return length > 0.0f ? sum / length : last_;
}

std::uint32_t packArea(float faces, float dither) {
  if (!(faces > 0.0f)) return 0;
  int exponent = 0;
  const float mantissa = std::frexp(faces, &exponent);  // [0.5, 1)
  auto digits = static_cast<int>(mantissa * 4096.0f + dither);
  if (digits >= 4096) {
    digits = 2048;
    ++exponent;
  }
  exponent += 20;  // digits * 2^(exponent - 32)
  if (exponent < 0 || (exponent == 0 && digits == 2048)) return 1;
  if (exponent > 31) return 0xffffu;
  return static_cast<std::uint32_t>(exponent) << 11 | static_cast<std::uint32_t>(digits - 2048);
}

uvec4 VoxelSums::pack(float dither) const {
  // The sum may be rounded up to the next whole number.
  const auto cut = [dither](float x, std::uint32_t most) {
    const float units = std::clamp(x, 0.0f, 1.0f) * static_cast<float>(most) + dither;
    return std::min(static_cast<std::uint32_t>(units), most);
  };
  std::uint32_t c[6];
  for (int i = 0; i < 6; ++i) c[i] = cut(coverage[i], 63u);
  const glm::vec3 a = albedo / std::max(weight, 1e-30f);
  const float d = byDirection;
  const std::uint32_t share = d >= 0.5f ? 3u : d >= 0.125f ? 2u : d >= 0.03125f ? 1u : 0u;
  return {c[0] | c[1] << 6 | c[2] << 12 | c[3] << 18 | c[4] << 24 | share << 30,
          c[5] | packer().asvoPackNormal(normal),
          cut(a.x, 255u) | cut(a.y, 255u) << 8 | cut(a.z, 255u) << 16 | plane << 24,
          material | packArea(area, dither) << 16};
}

void LeafBuilder::start(const glm::vec3& p) {
  corner_ = p;
  mask_ = 0;
  merged_ = false;
  pieces_.clear();
  corners_.clear();
  moments_ = {};
}

/// Sub-voxels of the leaf that a triangle touches.
std::uint64_t LeafBuilder::touchedBy(const GridTriangle& triangle, GroupMask groups) const {
  if (triangle.box) return triangle.box->subVoxels(corner_, groups);
  const glm::vec3 low = glm::max(glm::floor(triangle.lower) - corner_, 0.0f);
  const glm::vec3 high = glm::min(glm::floor(triangle.upper) - corner_, kSubVoxels - 1.0f);
  if (!glm::all(glm::lessThanEqual(low, high))) return 0;
  const glm::uvec3 first(low), last(high),
      bits = (glm::uvec3(2u) << last) - (glm::uvec3(1u) << first);
  return maskOfX(bits.x) & maskOfY(bits.y) & maskOfZ(bits.z);
}

void LeafBuilder::add(const GridTriangle& triangle, GroupMask groups) {
  constexpr float kHalf = 0.5f * kSubVoxels;
  constexpr float kFace = kSubVoxels * kSubVoxels;
  const std::uint64_t bits = touchedBy(triangle, groups);
  if (bits == 0) return;
  mask_ |= bits;
  const bool inside = glm::all(glm::lessThanEqual(corner_, triangle.lower)) &&
                      glm::all(glm::lessThanEqual(triangle.upper, corner_ + 2.0f * kHalf));
  const glm::dvec3 centre = glm::dvec3(corner_) + 0.5 * kSubVoxels;
  const float tolerance = static_cast<float>(grid_.tolerance());
  glm::vec3 half(kHalf);
  float share = 1.0f;
  if (triangle.flatAxis >= 0) {
    // A triangle that lies in the face between two leaves counts half in each.
    const int axis = triangle.flatAxis;
    const double place = triangle.vertex[0][axis];
    const bool shared = std::abs(std::abs(place - centre[axis]) - kHalf) <= grid_.tolerance();
    const bool edge = place < 1.0 || place > grid_.cells() - 1.0;
    half[axis] += 2.0f * tolerance;
    if (shared && !edge) share = 0.5f;
  }
  Polygon polygon = inside ? placed(triangle, centre) : clipTriangle(triangle, centre, half);
  Piece piece;
  piece.normal = glm::vec3(triangle.normal);
  Moments moments = momentsOf(polygon, piece.normal);
  if (polygon.count == 0) {
    polygon = clipTriangle(triangle, centre, half + glm::vec3(2.0f * tolerance));
    moments = momentsOf(polygon, piece.normal);
    share = 0.0f;
  }
  const glm::vec3 centroid = centroidOf(polygon, moments);
  moments_.add(moments, share);
  piece.weight = moments.area * share * (1.0f / kFace) + kTrifle;
  piece.material = std::min(triangle.source.material, 65535u);
  piece.shade = triangle.shade ? *triangle.shade
                : inside       ? shadeAt(source_, triangle.source, 1.0 / 3.0, 1.0 / 3.0)
                               : shadeAt(source_, triangle, centre + glm::dvec3(centroid));
  pieces_.push_back(piece);
  corners_.insert(corners_.end(), polygon.corner, polygon.corner + polygon.count);
  if (pieces_.size() >= kMaxPieces) mergePieces();
}

/// Bounds the memory of a leaf that holds millions of triangles: pieces that face alike (24
/// directions), with the same material, become one. Such a leaf has no plane.
void LeafBuilder::mergePieces() {
  auto keyOf = [](const Piece& piece) {
    const glm::vec3 size = glm::abs(piece.normal);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
    const std::uint32_t signs = (piece.normal.x < 0.0f ? 1u : 0u) |
                                (piece.normal.y < 0.0f ? 2u : 0u) |
                                (piece.normal.z < 0.0f ? 4u : 0u);
    return piece.material << 7 | static_cast<std::uint32_t>(axis) << 4 | signs << 1 |
           (piece.shade.emitsBack ? 1u : 0u);
  };
  std::stable_sort(pieces_.begin(), pieces_.end(),
                   [&](const Piece& a, const Piece& b) { return keyOf(a) < keyOf(b); });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < pieces_.size();) {
    const std::uint32_t key = keyOf(pieces_[i]);
    Piece sum = pieces_[i];
    sum.normal = glm::vec3(0.0f);
    sum.weight = 0.0f;
    sum.shade.albedo = sum.shade.emission = glm::vec3(0.0f);
    for (; i < pieces_.size() && keyOf(pieces_[i]) == key; ++i) {
      const Piece& piece = pieces_[i];
      sum.weight += piece.weight;
      sum.normal += piece.weight * piece.normal;
      sum.shade.albedo += piece.weight * piece.shade.albedo;
      sum.shade.emission += piece.weight * piece.shade.emission;
    }
    sum.shade.albedo /= sum.weight;
    sum.shade.emission /= sum.weight;
    const float length = glm::length(sum.normal);
    sum.normal = length > 0.0f ? sum.normal / length : glm::vec3(0.0f, 0.0f, 1.0f);
    pieces_[kept++] = sum;
  }
  pieces_.resize(kept);
  corners_.clear();
  merged_ = true;
}

std::uint32_t LeafBuilder::dominantMaterial() {
  materials_.clear();
  for (const Piece& piece : pieces_) {
    auto same = [&](const auto& entry) { return entry.first == piece.material; };
    auto found = std::find_if(materials_.begin(), materials_.end(), same);
    if (found == materials_.end()) found = materials_.insert(found, {piece.material, 0.0f});
    found->second += piece.weight;
  }
  auto less = [](const auto& a, const auto& b) { return a.second < b.second; };
  return std::max_element(materials_.begin(), materials_.end(), less)->first;
}

/// The plane, if all corners lie within a quarter of a sub-voxel of it.
std::uint32_t LeafBuilder::planeByte(const glm::vec3& normal) const {
  if (merged_) return 0;
  float low = 1e30f, high = -1e30f;
  for (const glm::vec3& corner : corners_) {
    const float height = glm::dot(normal, corner);
    low = std::min(low, height);
    high = std::max(high, height);
  }
  if (!(high - low <= 0.5f && high >= low)) return 0;
  const float offset = 0.5f * (low + high) / (kSubVoxels * ASVO_PLANE_STEP);
  return static_cast<std::uint32_t>(std::clamp(std::round(offset) + 128.0f, 1.0f, 255.0f));
}

void LeafBuilder::finish(std::uint64_t key, LeafList& out) {
  if (mask_ == 0) return;
  const double edge = kSubVoxels / grid_.scale();
  const float face = static_cast<float>(edge * edge);  // m^2
  VoxelSums sums;
  sums.normal = alignedNormal(pieces_);
  EmittedPower power{static_cast<std::uint32_t>(out.keys.size()), {vec3(0.0f), vec3(0.0f)}};
  glm::vec2 sides(0.0f);
  for (const Piece& piece : pieces_) {
    const int side = glm::dot(piece.normal, sums.normal) >= 0.0f ? 0 : 1;
    const float weight = piece.weight;
    sides[side] += weight;
    for (int axis = 0; axis < 3; ++axis) {
      sums.coverage[2 * axis + (piece.normal[axis] < 0.0f ? 1 : 0)] +=
          weight * std::abs(piece.normal[axis]);
    }
    sums.albedo += weight * piece.shade.albedo;
    sums.weight += weight;
    if (piece.shade.byDirection) sums.byDirection += weight;
    power.side[side] += weight * face * piece.shade.emission;
    if (piece.shade.emitsBack) power.side[1 - side] += weight * face * piece.shade.emission;
  }
  sums.area = std::max(sides.x, sides.y);
  const float byDirection = sums.byDirection * face;
  sums.byDirection /= sums.weight;
  sides *= face;
  sums.material = dominantMaterial();
  sums.plane = planeByte(packer().asvoUnpackNormal(packer().asvoPackNormal(sums.normal)));
  if (power.side[0] + power.side[1] != vec3(0.0f)) out.emitters.push_back(power);
  out.keys.push_back(key);
  out.voxels.push_back(sums.pack(ditherOf(key)));
  out.leaves.emplace_back(static_cast<std::uint32_t>(mask_),
                          static_cast<std::uint32_t>(mask_ >> 32));
  // Lengths in leaf edges, areas in m^2.
  Moments moments;
  moments.add(moments_.moved(1.0f / kSubVoxels, glm::vec3(0.0f)), face / (kSubVoxels * kSubVoxels));
  out.surfaces.push_back({sides, byDirection, moments});
}

}  // namespace asvo
