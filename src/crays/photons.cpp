#include "src/crays/photons.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "src/crays/bsdf.h"
#include "src/crays/clear_path.h"
#include "src/crays/lights_detail.h"

namespace trex {
namespace {

constexpr int kPhotonBounces = 64;
constexpr std::uint64_t kChunk = 1024;

/// Scattered by a medium into a new direction, or absorbed: false.
bool scatterInMedium(const MediaCollision& collision, Sampler& sampler, RayStart& start,
                     vec3& direction, vec3& power) {
  const float survival = maxComponent(collision.albedo);
  if (!(survival > 0.0f) || sampler.next1D() >= survival) return false;
  power *= collision.albedo / survival;
  start = start.position + dvec3(direction) * double(collision.distance);
  direction = sampleHenyeyGreenstein(direction, collision.anisotropy, sampler.next2D());
  return true;
}

/// Follows one photon to the first surface that can hold light, or on to all others. It is
/// scattered by media once, before its first surface, as C-rays see it (PathTracer::passMedia);
/// later media just take photons away.
void follow(const Scene& scene, const RayScene& rays, Sampler& sampler, const EmittedPhoton& photon,
            bool allBounces, LandedPhoton out, std::vector<LandedPhoton>& landed) {
  const Media* const media = rays.media();
  RayStart start = photon.start;
  vec3 direction = photon.direction, power = photon.power;
  const float emitted = maxComponent(power);
  RangeOnTheWay range(photon.range);
  bool scatters = photon.scatters;
  std::uint32_t turns = 0;  // as Scene::maxBounces counts; two more follow where it lands
  for (int bounce = 0; bounce < kPhotonBounces; ++bounce) {
    RayHit hit;
    const bool met = rays.intersect(start, direction, 0.0f, kInfinity, hit);
    MediaCollision collision;
    if (media != nullptr &&
        media->collide(start.position, direction, met ? hit.t : kInfinity, sampler, collision)) {
      if (!scatters || !scatterInMedium(collision, sampler, start, direction, power)) return;
      range.advance(collision.distance);
      power *= range.end();
      scatters = false;
      ++turns;
      continue;
    }
    if (!met) return;
    range.advance(hit.t);
    const Surface surface = rays.surface(hit);
    const Bsdf bsdf(scene, surface, -direction);
    BsdfSample next;
    if (bsdf.unlit()) return;
    start = surface.leave();
    if (bsdf.coverage() < 1.0f && sampler.next1D() >= bsdf.coverage()) {
      next.direction = direction;
    } else {
      if (bsdf.cacheable()) {
        if (turns + 2 > scene.maxBounces) return;
        out.power = power * range.factor();
        if (!isFinite(out.power) || !(maxComponent(out.power) > 0.0f)) return;
        out.position = vec3(surface.position);
        out.normal = bsdf.geometricNormal();
        landed.push_back(out);
        if (!allBounces) return;
        ++out.bounce;
      }
      if (!bsdf.sample(sampler, next)) return;
      if (!next.delta || !next.transmitted || !ClearLayers::clear(bsdf)) {
        ++turns;
        power *= range.end();
      }
      power *= next.weight * (next.etaSquared * bsdf.photonFactor(next.direction));
      const float survival = std::min(1.0f, maxComponent(power) / emitted);
      if (!(survival > 0.0f) || sampler.next1D() >= survival) return;
      power /= survival;
      scatters = false;
      if (!rays.leave(surface, next.direction, bsdf.leavesFront(next.direction), start)) return;
    }
    direction = next.direction;
  }
}

}  // namespace

std::vector<LandedPhoton> landPhotons(const Scene& scene, const RayScene& rays,
                                      const LightSet& lights, std::uint32_t seed,
                                      std::uint64_t first, std::uint64_t count, bool allBounces,
                                      std::span<const EmissionGuide> guides) {
  const std::uint64_t chunks = (count + kChunk - 1) / kChunk;
  std::vector<std::vector<LandedPhoton>> landed(chunks);
  tbb::parallel_for(std::uint64_t{0}, chunks, [&](std::uint64_t chunk) {
    const std::uint64_t end = std::min(count, (chunk + 1) * kChunk);
    for (std::uint64_t i = chunk * kChunk; i < end; ++i) {
      const auto index = static_cast<std::uint32_t>(first + i);
      Sampler sampler(0x70686f74u, index, seed);
      EmittedPhoton photon;
      LandedPhoton out{};
      if (!lights.emit(sampler, photon, guides)) continue;
      out.index = index;
      out.source = photon.source;
      out.primary = photon.primary;
      out.density = photon.density;
      follow(scene, rays, sampler, photon, allBounces, out, landed[chunk]);
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
