#include "src/paths/path_tracer.h"

#include <algorithm>
#include <cmath>

#include "src/paths/wave.h"

namespace trex {
namespace {

constexpr int kRouletteFrom = 3;   // bounces before Russian roulette may end a path
constexpr int kMostBounces = 256;  // a backstop: roulette ends paths long before

}  // namespace

/// Chooses the next direction. False where the path ends.
bool PathTracer::scatter(WavePath& path) const {
  const Bsdf& bsdf = *path.bsdf;
  BsdfSample next;
  if (++path.bounces >= kMostBounces || !bsdf.sample(path.sampler, next)) return false;
  if (path.caustics != nullptr && !next.delta) {
    path.spread |= !bsdf.goesOnSharp(path.sampler, next);
  }
  path.throughput *= next.weight;
  path.roulette *= next.etaSquared;
  if (path.bounces >= kRouletteFrom) {
    // The square root costs a tenth more rays and takes more than that of the noise.
    const float survival =
        std::min(0.95f, std::sqrt(maxComponent(path.throughput) * path.roulette));
    if (!(survival > 0.0f) || path.sampler.next1D() >= survival) return false;
    path.throughput /= survival;
  }
  if (!(maxComponent(path.throughput) > 0.0f)) return false;
  path.certain &= bsdf.showsOthers() && bsdf.oneLobe();
  const bool front = bsdf.leavesFront(next.direction);
  if (!rays_.leave(path.surface, next.direction, front, path.start)) return false;
  if (next.delta && next.transmitted && ClearLayers::clear(bsdf)) {
    passClear(path, next.direction);
  } else {
    if (++path.turns > scene_.maxBounces) return false;
    path.turn(bsdf.transmits() ? vec3(0.0f) : bsdf.normal());
    path.scatterPdf = next.delta ? kInfinity : next.pdf;
    if (!next.delta) ++path.scattered;
    path.roughness = next.roughness;
    path.coneRay = path.coneVertex && !next.delta;
  }
  path.direction = next.direction;
  path.tnear = 0.0f;
  if (next.transmitted) path.absorption = bsdf.absorptionTowards(next.direction, path.absorption);
  return true;
}

/// Goes on behind clear glass: light that was sampled at the last vertex passes it too.
void PathTracer::passClear(WavePath& path, const vec3& direction) const {
  const Bsdf& bsdf = *path.bsdf;
  path.pass(path.hit.t);
  if (!bsdf.refracts()) return;
  if (!path.clear.begun()) path.clear.begin(path.direction, path.travelled);
  path.clear.refract(bsdf.normal(), bsdf.eta(), direction);
}

}  // namespace trex
