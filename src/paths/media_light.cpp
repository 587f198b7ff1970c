#include "src/paths/path_tracer.h"

#include <algorithm>
#include <cmath>

#include "src/paths/wave.h"

namespace trex {

/// What a path meets of media on its next `distance` metres: their emission and light that they
/// scatter once are added, what comes after is dimmed.
void PathTracer::passMedia(WavePath& path, float distance) const {
  const MediaStretch s =
      media_->stretch(path.start.position, path.direction, distance, path.sampler);
  if (s.emission != vec3(0.0f)) path.add(path.throughput * s.emission, path.scattered <= 1);
  if (s.scatter != vec3(0.0f) && path.turns < scene_.maxBounces) {
    const dvec3 point = path.start.position + dvec3(path.direction) * double(s.distance);
    const vec3 light = scatteredLight(path, point, s.anisotropy);
    if (light != vec3(0.0f)) path.add(path.throughput * s.scatter * light, path.scattered == 0);
  }
  path.throughput *= s.transmittance;
}

/// Light that arrives at a point of a medium, times the phase function towards the path: by light
/// sampling and, for lights that rays can hit, by sampling the phase function, so that points close
/// to a light of some size do not stand out.
vec3 PathTracer::scatteredLight(WavePath& path, const dvec3& point, float anisotropy) const {
  vec3 sum(0.0f);
  LightSample light;
  if (!lights_.empty() && lights_.sample(point, path.sampler, light)) {
    const LightConnection way = connect(path, point, light.direction, light.end(), vec3(0.0f));
    const float phase = henyeyGreenstein(glm::dot(way.direction, path.direction), anisotropy);
    const float pdf = light.pdfBy(way);
    const float weight = light.delta ? 1.0f : powerHeuristic(pdf, phase);
    sum += light.radiance * way.passed * (phase * weight / pdf);
  }
  if (lights_.canBeHit()) {
    const vec3 to = sampleHenyeyGreenstein(path.direction, anisotropy, path.sampler.next2D());
    const float phase = henyeyGreenstein(glm::dot(to, path.direction), anisotropy);
    sum += lightAlong(path, point, to, phase);
  }
  return sum;
}

/// Radiance of the light that a ray from a point of a medium meets, dimmed by media. `pdf`: density
/// of the direction.
vec3 PathTracer::lightAlong(WavePath& path, const dvec3& point, const vec3& direction,
                            float pdf) const {
  ClearWalk walk{.start = point, .direction = direction};
  vec3 sum(0.0f);
  ++path.counts->shadowRays;
  for (int layer = 0; layer < ClearLayers::kMost; ++layer) {
    RayHit hit;
    if (!rays_.intersect(walk.start, walk.direction, 0.0f, kInfinity, hit)) {
      if (!lights_.hasEnvironment()) return sum;
      const float density = walk.path.straight(walk.direction) ? pdf : kInfinity;
      const float weight = powerHeuristic(density, lights_.pdfEnvironment(point, direction));
      return sum + walk.passed * lights_.environment(walk.direction) *
                       (weight * media_->transmittance(point, direction, kInfinity));
    }
    walk.advance(hit.t);
    const Surface surface = rays_.surface(hit);
    const Bsdf bsdf(scene_, surface, -walk.direction);
    if (!bsdf.unlit() && maxComponent(bsdf.emission()) > 0.0f) {
      const float weight =
          emitterWeight(walk.path.straight(walk.direction) ? pdf : kInfinity, point, point,
                        walk.path, walk.length, walk.direction, surface, hit);
      sum += walk.passed * bsdf.emission() *
             (bsdf.coverage() * weight * media_->transmittance(point, direction, walk.length));
    }
    if (!layers_.pass(surface, bsdf, walk)) break;
  }
  return sum;
}

}  // namespace trex
