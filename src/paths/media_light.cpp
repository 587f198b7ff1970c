#include "src/paths/path_tracer.h"

#include <algorithm>
#include <cmath>

#include "src/crays/waiting_ray.h"
#include "src/paths/medium_light.h"
#include "src/paths/wave.h"

namespace trex {

/// What a path meets of media on its next `distance` metres: their emission and light that they
/// scatter once are added, what comes after is dimmed.
void PathTracer::passMedia(WavePath& path, float distance) const {
  MediumLight here;
  const MediumLight* m = path.medium;
  if (m == nullptr) {
    drawMedium(path, distance, here);
    lightMedium(here, nullptr);
    m = &here;
  }
  const MediaStretch& s = m->stretch;
  if (s.emission != vec3(0.0f)) path.add(path.throughput * s.emission, path.scattered <= 1);
  const vec3 light = m->sum + m->along;
  if (light != vec3(0.0f)) path.add(path.throughput * s.scatter * light, path.scattered == 0);
  path.throughput *= s.transmittance;
}

/// Chooses where on a stretch media scatter light, and the two rays that look for it: to a light,
/// and, for lights that rays can hit, by the phase function, so that points close to a light of
/// some size do not stand out. `m` has its values at their defaults.
void PathTracer::drawMedium(WavePath& path, float distance, MediumLight& m) const {
  m.forward = path.direction;
  m.stretch = media_->stretch(path.start.position, path.direction, distance, path.sampler);
  if (m.stretch.scatter == vec3(0.0f) || path.turns >= scene_.maxBounces) return;
  m.point = path.start.position + dvec3(path.direction) * double(m.stretch.distance);
  m.asks = !lights_.empty() && lights_.sample(m.point, path.sampler, m.light);
  m.looks = lights_.canBeHit();
  if (m.looks) {
    m.to = sampleHenyeyGreenstein(m.forward, m.stretch.anisotropy, path.sampler.next2D());
    m.walk = {.start = m.point, .direction = m.to};
  }
  path.counts->shadowRays += (m.asks ? 1 : 0) + (m.looks ? 1 : 0);
}

/// Light that arrives where a medium scatters it, times the phase function towards the path. False
/// if a ray waits for a page; none does if `waits` is null.
bool PathTracer::lightMedium(MediumLight& m, WaitingRay* waits) const {
  if (m.asks) {
    const RayEnd end = m.light.end();
    const vec3 none(0.0f);  // is absorbed
    if (waits == nullptr) {
      m.way.found = layers_.connect(m.point, m.light.direction, end, none);
    } else if (!layers_.connectHere(m.point, m.light.direction, end, none, *waits, m.way)) {
      return false;
    }
    const LightConnection way = throughMedia(m.way.found, m.point, m.light.direction, end);
    const float phase = henyeyGreenstein(glm::dot(way.direction, m.forward), m.stretch.anisotropy);
    const float pdf = m.light.pdfBy(way);
    const float weight = m.light.delta ? 1.0f : powerHeuristic(pdf, phase);
    m.sum = m.light.radiance * way.passed * (phase * weight / pdf);
    m.asks = false;
  }
  return !m.looks || lightAlong(m, waits);
}

/// Radiance of the light that a ray from a point of a medium meets, dimmed by media. False if the
/// ray waits.
bool PathTracer::lightAlong(MediumLight& m, WaitingRay* waits) const {
  ClearWalk& walk = m.walk;
  const float pdf = henyeyGreenstein(glm::dot(m.to, m.forward), m.stretch.anisotropy);
  for (; walk.layers < ClearLayers::kMost; ++walk.layers) {
    RayHit hit;
    bool met = false;
    if (!layers_.meet(walk, kInfinity, waits, hit, met)) return false;
    if (!met) {
      if (!lights_.hasEnvironment()) break;
      const float density = walk.path.straight(walk.direction) ? pdf : kInfinity;
      const float weight = powerHeuristic(density, lights_.pdfEnvironment(m.point, m.to));
      m.along += walk.passed * lights_.environment(walk.direction) *
                 (weight * media_->transmittance(m.point, m.to, kInfinity));
      break;
    }
    walk.advance(hit.t);
    const Surface surface = rays_.surface(hit);
    const Bsdf bsdf(scene_, surface, -walk.direction);
    if (!bsdf.unlit() && maxComponent(bsdf.emission()) > 0.0f) {
      const float weight =
          emitterWeight(walk.path.straight(walk.direction) ? pdf : kInfinity, m.point, m.point,
                        walk.path, walk.length, walk.direction, surface, hit, nullptr);
      m.along += walk.passed * bsdf.emission() *
                 (bsdf.coverage() * weight * media_->transmittance(m.point, m.to, walk.length));
    }
    if (!layers_.pass(surface, bsdf, walk)) break;
  }
  return true;
}

}  // namespace trex
