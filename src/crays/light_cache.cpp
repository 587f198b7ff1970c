#include "src/crays/light_cache.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace trex {
namespace {

constexpr std::uint32_t kCoarserForFootprint = 2;  // levels that a wide footprint may go up
/// Photons a leaf from which on it may go up a level less, and again so many times as many: coarse
/// voxels spread light over the edges of shadows, and are read for their smaller noise alone.
constexpr double kPhotonsOfLeaf = 1.0, kForALevel = 8.0;
/// Levels that every footprint goes up where voxels have fewer photons than kPhotonsOfLeaf: so few
/// make spots rather than light.
constexpr std::uint32_t kCoarserForNoise = 2;
/// Cosine between a surface and its voxel's normal. Where surfaces of all directions meet in one
/// voxel, as wall, roof and their outer faces do, one that stands across its normal has no side.
/// Three walls of a corner have 0.577.
constexpr float kLeastCosine = 0.5f;
/// Of a voxel's area over what of it can be seen along the axes: more lies in layers, as a carpet
/// on a floor or a lamp under its ceiling, whose light is not that of the one that is seen.
constexpr float kMostLayers = 1.1f;

}  // namespace

LightCache::LightCache(const asvo::Tree& tree)
    : tracer_(tree),
      nodes_(tree.nodes),
      info_(tree.info),
      leafSize_(tree.info.size / static_cast<float>(1u << tree.info.depth)) {
  if (info_.depth < kTable) return;
  constexpr std::uint32_t kMask = (1u << kTable) - 1;
  table_.resize(std::size_t{1} << 3 * kTable);
  for (std::uint32_t i = 0; i < table_.size(); ++i) {
    const glm::uvec3 cell(i & kMask, i >> kTable & kMask, i >> 2 * kTable);
    table_[i] = tracer_.asvoFindCell(cell, kTable);
  }
}

/// As Tracer::asvoFind().
std::uint32_t LightCache::voxelAt(const vec3& position, std::uint32_t level) const {
  if (table_.empty() || level < kTable) return tracer_.asvoFind(position, level);
  const vec3 g = tracer_.asvoGridPosition(position, level);
  if (!tracer_.asvoInside(g, static_cast<float>(1u << level))) return asvo::ASVO_NONE;
  const glm::uvec3 cell(g);
  std::uint32_t shift = level - kTable;
  const glm::uvec3 top = cell >> shift;
  std::uint32_t voxel = table_[top.x | top.y << kTable | top.z << 2 * kTable];
  while (shift > 0 && voxel != asvo::ASVO_NONE) {
    const std::uint32_t octant = tracer_.asvoOctant(glm::ivec3(cell), --shift);
    const asvo::uvec2& node = nodes_[voxel];
    const bool there = (node.y >> octant & 1u) != 0;
    const auto before = static_cast<std::uint32_t>(std::popcount(node.y & ((1u << octant) - 1u)));
    voxel = there ? node.x + before : asvo::ASVO_NONE;
  }
  return voxel;
}

void LightCache::setLight(std::span<const asvo::uvec4> light, double scale, double photons,
                          std::span<const asvo::uvec4> before, double photonsBefore) {
  light_ = light;
  lots_ = {};
  before_ =
      photonsBefore > 0.0 && photonsBefore < photons ? before : std::span<const asvo::uvec4>();
  // With M of N photons before, light less before has (N - M) / M times the variance of light.
  noiseScale_ = before_.empty()
                    ? 0.0f
                    : static_cast<float>(std::sqrt(photonsBefore / (photons - photonsBefore)));
  scale_ = static_cast<float>(scale);
  coarser_ = kCoarserForFootprint;
  for (double enough = kPhotonsOfLeaf * info_.leafCount; coarser_ > 0 && photons >= enough;) {
    enough *= kForALevel;
    --coarser_;
  }
  least_ = 0;
  for (double leaves = info_.leafCount;
       least_ < kCoarserForNoise && photons < kPhotonsOfLeaf * leaves;) {
    leaves *= 0.25;  // a surface has a quarter of the voxels a level up
    ++least_;
  }
}

LightCache::Place LightCache::find(const vec3& position, const vec3& normal, float radius,
                                   vec2 jitter) const {
  if (light_.empty()) return {};
  const float wide = std::max(radius / leafSize_, 1.0f);
  const auto up =
      std::max(std::min(static_cast<std::uint32_t>(std::ilogb(wide)), coarser_), least_);
  const std::uint32_t level = info_.depth - std::min(up, info_.depth);
  const float edge = info_.size / static_cast<float>(1u << level);
  const Basis basis(normal);
  const vec3 moved = position + basis.tangent * ((jitter.x - 0.5f) * edge) +
                     basis.bitangent * ((jitter.y - 0.5f) * edge);
  std::uint32_t voxel = voxelAt(moved, level);
  if (voxel == asvo::ASVO_NONE) voxel = tracer_.asvoFindNear(position, normal, level);
  if (voxel == asvo::ASVO_NONE) return {};
  const float cosine = glm::dot(tracer_.asvoNormal(voxel), normal);
  if (std::abs(cosine) < kLeastCosine || !(tracer_.asvoArea(voxel) > 0.0f)) return {};
  if (tracer_.asvoArea(voxel) > kMostLayers * tracer_.asvoShownArea(voxel)) return {};
  return {voxel, cosine > 0.0f};
}

vec3 LightCache::read(std::span<const asvo::uvec4> light, const Place& place) const {
  const asvo::uvec4& packed = light[place.voxel];
  return tracer_.asvoUnpackRgb9e5(place.front ? packed.x : packed.y) * scale_;
}

bool LightCache::irradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                            vec3& out) const {
  const Place place = find(position, normal, radius, jitter);
  if (place.voxel == asvo::ASVO_NONE) return false;
  out = read(light_, place);
  return true;
}

bool LightCache::noisyIrradiance(const vec3& position, const vec3& normal, float radius,
                                 vec2 jitter, std::uint32_t lot, vec3& out, vec3& noise) const {
  const Place place = find(position, normal, radius, jitter);
  if (place.voxel == asvo::ASVO_NONE) return false;
  out = read(light_, place);
  noise = vec3(0.0f);
  if (before_.empty()) return true;
  noise = noiseScale_ * (lots_.before(position) * out - read(before_, place)) +
          lots_.noise(position, lot) * out;
  return true;
}

}  // namespace trex
