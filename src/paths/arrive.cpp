#include "src/paths/path_tracer.h"

#include "src/paths/wave.h"

namespace trex {

/// Takes what the surface sends out, and cached light.
Fate PathTracer::arrive(WavePath& path) const {
  const Surface& surface = path.surface;
  const Bsdf& bsdf = path.bsdf.emplace(scene_, surface, -path.direction);
  if (path.absorption != vec3(0.0f)) path.throughput *= glm::exp(-path.absorption * path.hit.t);
  if (media_ != nullptr) passMedia(path, path.hit.t);

  if (bsdf.coverage() > 0.0f && bsdf.coverage() < 1.0f) path.certain = false;
  const bool passes = bsdf.coverage() < 1.0f && path.sampler.next1D() >= bsdf.coverage();
  path.length += path.hit.t;
  if (passes) return passLayer(path) ? Fate::kPasses : Fate::kEnds;
  look(path);
  if (maxComponent(bsdf.emission()) > 0.0f) emit(path);
  if (bsdf.unlit() || (path.look && path.seen)) return Fate::kEnds;
  if (path.look || path.turns >= scene_.maxBounces) return Fate::kScatters;
  if (path.coupled && guess_.cache && bsdf.cacheable() &&
      endInCache(path, bsdf.geometricNormal(), nullptr) && !path.part()) {
    return Fate::kEnds;
  }

  path.coneVertex = handsToCones(path, bsdf.cacheable()) && !bsdf.onlyDelta();
  path.here().moveTo(surface.position, bsdf.transmits() ? vec3(0.0f) : bsdf.normal());
  return bsdf.onlyDelta() ? Fate::kScatters : Fate::kLit;
}

/// The same at a plain surface, which sends nothing out and lets nothing pass.
Fate PathTracer::arrivePlain(WavePath& path, const Wave& wave) const {
  const PlainLanes& lanes = wave.lanesOf(path.place);
  const std::size_t lane = Wave::laneOf(path.place);
  if (path.absorption != vec3(0.0f)) path.throughput *= glm::exp(-path.absorption * path.hit.t);
  path.length += path.hit.t;
  const vec3 normal = PlainLanes::vector(lanes.normal, lane);
  meet(path);
  const bool matte = PlainLanes::is(lanes.lambertian, lane);
  const vec3 own = glm::min(PlainLanes::vector(lanes.diffuse, lane), vec3(1.0f));
  if (!path.seen) see(path, matte ? own : bsdfOf(path).albedo(), normal);
  if (path.look) return Fate::kEnds;
  if (path.turns >= scene_.maxBounces) return Fate::kScatters;
  const bool cacheable = lanes.specularLobe[lane] * lanes.metallic[lane] <= Bsdf::kMostSharp;
  if (path.coupled && guess_.cache && cacheable &&
      endInCache(path, PlainLanes::vector(lanes.facing, lane), matte ? &own : nullptr) &&
      !path.part()) {
    return Fate::kEnds;
  }
  path.coneVertex = handsToCones(path, cacheable);
  path.here().moveTo(path.surface.position, normal);
  return Fate::kLit;
}

/// Whether a surface hands its far field to cones. Cached light has been reflected once more.
bool PathTracer::handsToCones(const WavePath& path, bool cacheable) const {
  return path.coupled && !path.byRays && cacheable && scene_.maxBounces - path.turns >= 2 &&
         mayEndAfter(path.turns + 1u);
}

/// Whether cached light may end a path that has turned so often, fewer times than it may at most.
/// Light of no or few turns more differs from place to place (TurnShares), and costs few rays.
bool PathTracer::mayEndAfter(std::uint32_t turns) const {
  constexpr std::uint32_t kFewTurns = 2;
  return turns <= 1 || scene_.maxBounces - turns > kFewTurns;
}

/// Of light that is cached at a place, what a path that has turned so often may see: cached light
/// has turned as often as one may see that has turned once.
float PathTracer::cachedShare(const vec3& position, std::uint32_t turns) const {
  if (turns <= 1) return 1.0f;
  return guess_.cache->shareOfTurns(position, scene_.maxBounces - turns - 1u);
}

/// Goes on behind a transparent layer. False where there were too many.
bool PathTracer::passLayer(WavePath& path) const {
  path.start = path.surface.leave();
  path.tnear = 0.0f;
  path.pass(path.hit.t);
  ++path.layers;
  return ++path.bounces < ClearLayers::kMost;
}

/// What the camera's ray has met.
void PathTracer::meet(WavePath& path) const {
  if (path.bounces != path.layers) return;
  const Surface& surface = path.surface;
  path.sample->first = {camera_.depth(surface.position), static_cast<float>(surface.object),
                        static_cast<float>(surface.material)};
}

/// What the eye knows of the surface.
void PathTracer::look(WavePath& path) const {
  const Bsdf& bsdf = *path.bsdf;
  meet(path);
  if (path.seen || (bsdf.showsOthers() && !bsdf.unlit())) return;
  see(path, bsdf.albedo(), bsdf.normal());
}

void PathTracer::see(WavePath& path, const vec3& albedo, const vec3& normal) const {
  path.seen = true;
  const vec3 dimmed = glm::min(albedo * path.throughput, vec3(1.0f));  // by mirrors and glass
  path.sample->feature = {dimmed, normal, vec3(path.surface.position),
                          camera_.footprint(path.length),
                          maxComponent(albedo) > 0.0f ? 0.0f : 1.0f};
}

/// Light of an emitter, weighed against that of light sampling at the vertex.
void PathTracer::emit(WavePath& path) const {
  const Bsdf& bsdf = *path.bsdf;
  ClearPath way = path.clear;
  if (way.begun()) way.advance(path.hit.t);
  const float density = bsdf.unlit() ? kInfinity : path.density(),
              travelled = path.travelled + path.hit.t;
  const float weight = emitterWeight(density, path.left, path.lastPoint(), way, travelled,
                                     path.direction, path.surface, path.hit, path.emitter);
  const vec3 light = path.throughput * bsdf.emission() * weight;
  if (path.coneRay && path.coupled && density < kInfinity && travelled > nearField()) {
    // In place of a cone, which gathers no emission (ask()): the exact path's alone.
    path.sample->exact += light;
    if (path.scattered <= 1) path.sample->directExact += light;
  } else {
    path.addSeen(light);
  }
}

/// G1: reads the cache if the ray's footprint is wide enough here, on the side of a surface that
/// cached light serves. `albedo`: Bsdf::cachedAlbedo(), or null if the Bsdf is to tell. True if it
/// did.
bool PathTracer::endInCache(WavePath& path, const vec3& side, const vec3* albedo) const {
  if (!(path.density() < kInfinity) || !mayEndAfter(path.turns)) return false;
  const float radius = (path.travelled + path.hit.t) * guess_.footprint.spread(path.roughness);
  if (radius < guess_.footprint.cacheVoxels * guess_.cache->detail()) return false;
  const vec2 jitter = path.sampler.next2D();
  const vec3 position(path.surface.position);
  vec3 irradiance, noise(0.0f);
  const bool known = guess_.noise
                         ? guess_.cache->noisyIrradiance(position, side, radius, jitter,
                                                         path.sample->lot, irradiance, noise)
                         : guess_.cache->irradiance(position, side, radius, jitter, irradiance);
  if (!known) return false;
  const vec3 seen = path.throughput * cachedShare(position, path.turns);
  const vec3 sent = seen * (albedo != nullptr ? *albedo : bsdfOf(path).cachedAlbedo());
  path.sample->guess += sent * irradiance * kInvPi;
  path.sample->photonNoise += sent * noise * kInvPi;
  ++path.counts->cacheReads;
  return true;
}

}  // namespace trex
