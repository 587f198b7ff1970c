#include "src/crays/photons.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "src/crays/bsdf.h"

namespace trex {
namespace {

constexpr int kPhotonBounces = 64;
constexpr std::uint64_t kChunk = 1024;

/// Follows one photon; false if it never lands.
bool land(const Scene& scene, const RayScene& rays, Sampler& sampler, const EmittedPhoton& photon,
          LandedPhoton& out) {
  vec3 origin = photon.origin, direction = photon.direction, power = photon.power;
  const float start = maxComponent(power);
  for (int bounce = 0; bounce < kPhotonBounces; ++bounce) {
    RayHit hit;
    if (!rays.intersect(origin, direction, 0.0f, kInfinity, hit)) return false;
    const Surface surface = rays.surface(hit);
    const Bsdf bsdf(scene, surface, -direction);
    BsdfSample next;
    if (bsdf.unlit()) return false;
    if (bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage()) {
      next.direction = direction;
    } else if (bsdf.cacheable()) {
      out.position = surface.position;
      out.normal = bsdf.geometricNormal();
      out.power = power;
      return isFinite(power) && maxComponent(power) > 0.0f;
    } else {
      if (!bsdf.sample(sampler, next)) return false;
      power *= next.weight * next.etaSquared;
      const float survival = std::min(1.0f, maxComponent(power) / start);
      if (!(survival > 0.0f) || sampler.next1D() >= survival) return false;
      power /= survival;
    }
    direction = next.direction;
    origin = surface.leave(direction);
  }
  return false;
}

}  // namespace

std::vector<LandedPhoton> landPhotons(const Scene& scene, const RayScene& rays,
                                      const LightSet& lights, std::uint32_t seed,
                                      std::uint64_t first, std::uint64_t count,
                                      std::span<const EmissionGuide> guides) {
  const std::uint64_t chunks = (count + kChunk - 1) / kChunk;
  std::vector<std::vector<LandedPhoton>> landed(chunks);
  tbb::parallel_for(std::uint64_t{0}, chunks, [&](std::uint64_t chunk) {
    const std::uint64_t end = std::min(count, (chunk + 1) * kChunk);
    for (std::uint64_t i = chunk * kChunk; i < end; ++i) {
      const auto index = static_cast<std::uint32_t>(first + i);
      Sampler sampler(0x70686f74u, index, seed);
      EmittedPhoton photon;
      LandedPhoton out;
      if (lights.emit(sampler, photon, guides) && land(scene, rays, sampler, photon, out)) {
        out.index = index;
        out.source = photon.source;
        out.primary = photon.primary;
        out.density = photon.density;
        landed[chunk].push_back(out);
      }
    }
  });
  std::vector<LandedPhoton> all;
  for (const auto& part : landed) all.insert(all.end(), part.begin(), part.end());
  return all;
}

std::size_t learn(std::span<const LandedPhoton> landed, const ImportanceMap& importance,
                  std::span<EmissionGuide> guides) {
  std::size_t wanted = 0;
  for (const LandedPhoton& p : landed) {
    if (p.source >= guides.size() || guides[p.source].dimensions() == 0) continue;
    const float visits = importance.visits(p.position, p.normal);
    if (!(visits > 0.0f)) continue;
    guides[p.source].learn(p.primary, p.density, visits);
    ++wanted;
  }
  for (EmissionGuide& guide : guides) guide.update();
  return wanted;
}

}  // namespace trex
