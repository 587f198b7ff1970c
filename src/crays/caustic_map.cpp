#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "src/crays/caustics.h"

namespace trex {
namespace {

constexpr float kSameFacing = 0.7f;  // cosine of normals from which on photons lie on one surface
constexpr float kOffPlane = 0.3f;    // of the radius: farther off the tangent plane is another one
constexpr float kWidest = 0.1f;      // of the scene's radius
constexpr float kGrazing = 1e-3f;    // cosine

/// Epanechnikov's, over a disk.
float kernel(float distance2, float radius) {
  const float square = radius * radius;
  return 2.0f * kInvPi * std::max(0.0f, 1.0f - distance2 / square) / square;
}

/// Whether light of a photon may be taken at a point of a surface.
bool sameSurface(const CausticPhoton& photon, const vec3& point, const vec3& normal, float radius) {
  return std::abs(glm::dot(photon.normal, normal)) >= kSameFacing &&
         std::abs(glm::dot(photon.position - point, normal)) <= kOffPlane * radius;
}

/// A random point of a photon's disk: what its kernel brings there to a surface, over what it would
/// bring to a plane. Nothing beyond an edge.
float probe(const CausticPhoton& photon, float radius, const RayScene& rays, Sampler& sampler) {
  constexpr int kLayers = 8;
  const Basis basis(photon.normal);
  // Of the kernel's density: 1 - (1 - (r / radius)^2)^2 is uniform.
  const vec2 u = sampler.next2D();
  const float away = radius * std::sqrt(1.0f - std::sqrt(1.0f - u.x)), phi = 2.0f * kPi * u.y;
  const vec3 aside = away * (std::cos(phi) * basis.tangent + std::sin(phi) * basis.bitangent);
  const vec3 up = glm::dot(photon.towards, photon.normal) < 0.0f ? -photon.normal : photon.normal;
  const float height = 1.5f * kOffPlane * radius;
  RayStart from = dvec3(photon.position + aside + height * up);
  float left = 2.0f * height;
  for (int layer = 0; layer < kLayers; ++layer) {
    RayHit hit;
    if (!rays.intersect(from, -up, 0.0f, left, hit)) break;
    const Surface surface = rays.surface(hit);
    const vec3 point(surface.position), off = point - photon.position;
    if (sameSurface(photon, point, surface.geometricNormal, radius)) {
      const float cosine = std::abs(glm::dot(surface.geometricNormal, photon.normal));
      return kernel(glm::dot(off, off), radius) / (kernel(away * away, radius) * cosine);
    }
    from = surface.leave();
    left -= hit.t;
  }
  return 0.0f;
}

/// What a photon's power takes so that nothing is lost beyond edges: 1 over the share s of its
/// kernel that finds surfaces. Of n points in it and one more that does, n + 1 over those that do
/// is (1 - (1 - s)^(n + 1)) / s on average; how many more are wanted until one does, where n + 1 do
/// not, is the rest.
float gainOfEdges(const CausticPhoton& photon, float radius, const RayScene& rays,
                  Sampler& sampler) {
  constexpr int kPoints = 3, kMostPoints = 64;
  float sum = 1.0f;
  for (int i = 0; i < kPoints; ++i) sum += probe(photon, radius, rays, sampler);
  float gain = (kPoints + 1) / sum;
  if (sum > 1.0f || probe(photon, radius, rays, sampler) > 0.0f) return gain;
  for (int i = 0; i < kMostPoints; ++i) {
    gain += 1.0f;
    if (probe(photon, radius, rays, sampler) > 0.0f) break;
  }
  return gain;
}

}  // namespace

CausticWidths::CausticWidths(std::span<const CausticPhoton> photons, float scene, double wanted)
    : scene_(scene), wanted_(wanted) {
  // Cells of a level lie in those of the next: where none has enough, none of the finer ones has.
  bool enough = true;
  for (std::uint32_t level = kLevels - 1; level-- > 0 && enough;) {
    enough = false;
    for (const CausticPhoton& p : photons) {
      enough |= ++counts_[level][key(p.position, level)] >= leastInCell();
    }
  }
}

float CausticWidths::radius(std::uint32_t level) const {
  return kWidest * scene_ * std::exp2(static_cast<float>(level) - (kLevels - 1.0f));
}

/// Of the cell, two radii wide, that a place lies in.
std::uint64_t CausticWidths::key(const vec3& position, std::uint32_t level) const {
  const vec3 cell = glm::floor(position / (2.0f * radius(level)));
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    key =
        key << 21 | (static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis])) & 0x1fffffu);
  }
  return key;
}

std::uint32_t CausticWidths::level(const CausticPhoton& photon, vec2 u) const {
  const Basis basis(photon.normal);
  const vec3 aside = basis.tangent * (2.0f * u.x - 1.0f) + basis.bitangent * (2.0f * u.y - 1.0f);
  for (std::uint32_t level = 0; level + 1 < kLevels; ++level) {
    const auto at = counts_[level].find(key(photon.position + radius(level) * aside, level));
    if (at != counts_[level].end() && at->second >= leastInCell()) return level;
  }
  return kLevels - 1;
}

CausticMap::CausticMap(std::span<const CausticPhoton> photons, const CausticWidths& widths,
                       float shrink, const RayScene& rays) {
  constexpr std::size_t kChunk = 512;
  std::vector<CausticPhoton> whole(photons.begin(), photons.end());
  std::vector<std::uint32_t> levels(photons.size());
  tbb::parallel_for(std::size_t{0}, (photons.size() + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    for (std::size_t i = chunk * kChunk; i < std::min(photons.size(), (chunk + 1) * kChunk); ++i) {
      Sampler sampler(0x73706f74u, static_cast<std::uint32_t>(i), 0);
      levels[i] = widths.level(photons[i], sampler.next2D());
      const auto radius = [&] { return widths.radius(levels[i]) * shrink; };
      while (levels[i] > 0 && probe(photons[i], radius(), rays, sampler) <= 0.0f) --levels[i];
      whole[i].power *= gainOfEdges(photons[i], radius(), rays, sampler);
    }
  });
  std::array<std::vector<CausticPhoton>, CausticWidths::kLevels> byLevel;
  for (std::size_t i = 0; i < whole.size(); ++i) byLevel[levels[i]].push_back(whole[i]);
  for (std::uint32_t level = 0; level < CausticWidths::kLevels; ++level) {
    if (byLevel[level].empty()) continue;
    grids_.emplace_back(std::move(byLevel[level]), widths.radius(level) * shrink);
  }
}

std::size_t CausticMap::size() const {
  std::size_t sum = 0;
  for (const Grid& grid : grids_) sum += grid.photons.size();
  return sum;
}

CausticMap::Grid::Grid(std::vector<CausticPhoton> all, float width)
    : radius(width), photons(std::move(all)) {
  std::vector<std::pair<std::size_t, Entry>> placed;
  std::size_t buckets = 1;
  while (buckets < 2 * photons.size()) buckets *= 2;
  firsts.assign(buckets + 1, 0);
  occupied.assign((buckets * kBitsOfBucket + 63) / 64, 0);
  for (std::uint32_t i = 0; i < photons.size(); ++i) {
    const vec3& p = photons[i].position;
    const glm::ivec3 lower = cell(p - radius), upper = glm::min(cell(p + radius), lower + 1);
    for (glm::ivec3 c = lower; c.z <= upper.z; ++c.z) {
      for (c.y = lower.y; c.y <= upper.y; ++c.y) {
        for (c.x = lower.x; c.x <= upper.x; ++c.x) {
          const std::uint32_t h = hash(c);
          placed.emplace_back(h & (buckets - 1), Entry{p, i << 3 | parity(c)});
          ++firsts[placed.back().first + 1];
          occupied[bit(h) / 64] |= std::uint64_t{1} << bit(h) % 64;
        }
      }
    }
  }
  for (std::size_t i = 1; i <= buckets; ++i) firsts[i] += firsts[i - 1];
  std::vector<std::uint32_t> next(firsts.begin(), firsts.end() - 1);
  entries.resize(placed.size());
  for (const auto& [at, entry] : placed) entries[next[at]++] = entry;
}

glm::ivec3 CausticMap::Grid::cell(const vec3& position) const {
  constexpr float kMost = 1e9f;  // so that it fits an integer
  const vec3 at = glm::clamp(position / (2.0f * radius), vec3(-kMost), vec3(kMost));
  const glm::ivec3 towardsZero(at);
  return towardsZero - glm::ivec3(glm::lessThan(at, vec3(towardsZero)));
}

std::uint32_t CausticMap::Grid::hash(const glm::ivec3& c) {
  const glm::uvec3 u(c);
  const std::uint32_t key =
      (u.x * 0x9e3779b1u ^ u.y * 0x85ebca77u ^ u.z * 0xc2b2ae3du) * 0x27d4eb2fu;
  return key ^ key >> 15;
}

/// Calls use(photon, distance^2) for all within the radius.
template <typename Use>
void CausticMap::Grid::forNear(const vec3& position, const Use& use) const {
  const glm::ivec3 here = cell(position);
  const std::uint32_t h = hash(here);
  if ((occupied[bit(h) / 64] >> bit(h) % 64 & 1u) == 0) return;
  const std::size_t b = h & (firsts.size() - 2);
  for (std::uint32_t i = firsts[b]; i < firsts[b + 1]; ++i) {
    const Entry& entry = entries[i];
    const vec3 off = entry.position - position;
    const float distance2 = glm::dot(off, off);
    if (distance2 >= radius * radius || (entry.photon & 7u) != parity(here)) continue;
    use(photons[entry.photon >> 3], distance2);
  }
}

vec3 CausticMap::radiance(const Surface& surface, const Bsdf& bsdf, bool sharpToo) const {
  vec3 sum(0.0f);
  if (!sharpToo && !bsdf.hasBroad()) return sum;
  const vec3 at(surface.position), normal = bsdf.geometricNormal();
  for (const Grid& grid : grids_) {
    grid.forNear(at, [&](const CausticPhoton& p, float distance2) {
      if (!sameSurface(p, at, normal, grid.radius)) return;
      // Flux is by the surface's own area, what evaluate() takes by area across the light.
      const float cosine = std::max(std::abs(glm::dot(p.towards, normal)), kGrazing);
      const LobeKind kind = sharpToo && !p.blurred ? LobeKind::kAll : LobeKind::kBroad;
      sum += bsdf.evaluate(p.towards, kind) * p.power * (kernel(distance2, grid.radius) / cosine);
    });
  }
  return sum;
}

}  // namespace trex
