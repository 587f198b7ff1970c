#include "src/paths/path_tracer.h"

#include "src/paths/wave.h"
#include "src/scene/texture.h"

namespace trex {

/// Decodes the surfaces that were hit, and asks memory for their textures.
void PathTracer::decode(Wave& wave) const {
  for (WavePath* path : wave.underWay) {
    path->surface = rays_.surface(path->hit);
    const Material& material = scene_.materials[path->surface.material];
    for (const Texture* texture : {&material.baseColorTexture, &material.metallicRoughnessTexture,
                                   &material.normalTexture}) {
      if (!texture->present()) continue;
      prefetchTexture(scene_.images[static_cast<std::size_t>(texture->image)], *texture,
                      path->surface.texCoords[texture->set]);
    }
  }
}

/// Takes what the surface sends out, and cached light.
Fate PathTracer::arrive(WavePath& path) const {
  const Surface& surface = path.surface;
  const Bsdf& bsdf = path.bsdf.emplace(scene_, surface, -path.direction);
  path.coneVertex = false;
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
  if (path.coupled && guess_.cache && endInCache(path) && !path.part()) return Fate::kEnds;

  // Cached light has been reflected once more.
  path.coneVertex = guess_.cones && path.coupled && bsdf.cacheable() && !bsdf.onlyDelta() &&
                    scene_.maxBounces - path.turns >= 2;
  path.here().moveTo(surface.position, bsdf.transmits() ? vec3(0.0f) : bsdf.normal());
  return bsdf.onlyDelta() ? Fate::kScatters : Fate::kLit;
}

/// Goes on behind a transparent layer. False where there were too many.
bool PathTracer::passLayer(WavePath& path) const {
  path.start = path.surface.leave();
  path.tnear = 0.0f;
  path.pass(path.hit.t);
  ++path.layers;
  return ++path.bounces < ClearLayers::kMost;
}

/// What the eye knows of the surface.
void PathTracer::look(WavePath& path) const {
  const Surface& surface = path.surface;
  const Bsdf& bsdf = *path.bsdf;
  if (path.bounces == path.layers) {
    path.sample->first = {camera_.depth(surface.position), static_cast<float>(surface.object),
                          static_cast<float>(surface.material)};
  }
  if (path.seen || (bsdf.showsOthers() && !bsdf.unlit())) return;
  path.seen = true;
  const vec3 albedo = bsdf.albedo();
  const vec3 dimmed = glm::min(albedo * path.throughput, vec3(1.0f));  // by mirrors and glass
  path.sample->feature = {dimmed, bsdf.normal(), vec3(surface.position),
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
                                     path.direction, path.surface, path.hit);
  const vec3 light = path.throughput * bsdf.emission() * weight;
  if (path.coneRay && path.coupled && density < kInfinity && travelled > nearField()) {
    // In place of a cone, which gathers no emission (ask()): the exact path's alone.
    path.sample->exact += light;
    if (path.scattered <= 1) path.sample->directExact += light;
  } else {
    path.addSeen(light);
  }
}

/// G1: reads the cache if the ray's footprint is wide enough here. True if it did.
bool PathTracer::endInCache(WavePath& path) const {
  const Surface& surface = path.surface;
  const Bsdf& bsdf = *path.bsdf;
  if (!(path.density() < kInfinity) || !bsdf.cacheable()) return false;
  const float radius = (path.travelled + path.hit.t) * guess_.footprint.spread(path.roughness);
  if (radius < guess_.footprint.cacheVoxels * guess_.cache->leafSize()) return false;
  const vec2 jitter = path.sampler.next2D();
  vec3 irradiance;
  if (!guess_.cache->irradiance(vec3(surface.position), bsdf.geometricNormal(), radius, jitter,
                                irradiance)) {
    return false;
  }
  path.sample->guess += path.throughput * bsdf.cachedAlbedo() * irradiance * kInvPi;
  ++path.counts->cacheReads;
  return true;
}

}  // namespace trex
