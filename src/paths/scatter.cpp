#include "src/paths/path_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "src/paths/wave.h"

namespace trex {
namespace {

constexpr int kRouletteFrom = 3;      // bounces before Russian roulette may end a path
constexpr int kMostBounces = 256;     // a backstop: roulette ends paths long before
constexpr int kMostSeenThrough = 32;  // likewise of looks, which know no roulette

constexpr std::uint8_t kChoices = 2;  // of looks, both ways: a pane's two faces

/// The choice of a look at a surface that shows both of its sides.
float sideToSee(WavePath& path) {
  const float behind = path.bsdf->shareBehind();
  const bool other = path.choices < kChoices && ((path.number >> path.choices) & 1u) != 0;
  const bool seesBehind = (behind >= 0.5f) != other;
  if (path.choices < kChoices) path.sample->weight *= 2.0f * (seesBehind ? behind : 1.0f - behind);
  ++path.choices;
  return seesBehind ? 1.0f - 0x1p-24f : 0.0f;
}

}  // namespace

/// What a surface says of a direction that was chosen.
struct Turning {
  bool alone;  ///< there was no other, and what is seen in the surface stands for it
  bool front;  ///< leaves on the triangle's front
  vec3 normal;
};

/// Next rays of all paths; those that end are no longer under way.
void PathTracer::scatter(Wave& wave) const {
  Wave::Samples samples{};
  for (WavePath* path : wave.underWay) {
    if (path->fate == Fate::kPasses || !path->isPlain()) continue;
    Wave::draw(path->place, path->sampler, samples);
  }
  for (std::size_t i = 0; i < wave.plainBlocks(); ++i)
    plain_.kernels().sample(wave.plain[i], samples[i]);
  std::erase_if(wave.underWay, [&](WavePath* path) {
    if (path->fate == Fate::kPasses) return false;
    return !(path->isPlain() ? scatterPlain(*path, wave, samples) : scatter(*path));
  });
}

/// Chooses the next direction. False where the path ends.
bool PathTracer::scatter(WavePath& path) const {
  const Bsdf& bsdf = *path.bsdf;
  BsdfSample next;
  if (++path.bounces >= (path.look ? kMostSeenThrough : kMostBounces)) return false;
  const float choice = path.look && bsdf.showsBothSides() ? sideToSee(path) : path.sampler.next1D();
  if (!bsdf.sample(path.sampler, choice, next)) return false;
  if (path.caustics != nullptr && !next.delta) {
    path.spread |= !bsdf.goesOnSharp(path.sampler, next);
  }
  return goOn(path, next,
              {bsdf.showsOthers() && bsdf.oneLobe(), bsdf.leavesFront(next.direction),
               bsdf.transmits() ? vec3(0.0f) : bsdf.normal()});
}

bool PathTracer::scatterPlain(WavePath& path, const Wave& wave,
                              const PlainWave::Samples& samples) const {
  const PlainLanes& lanes = wave.lanesOf(path.place);
  const std::size_t lane = Wave::laneOf(path.place);
  BsdfSample next;
  if (++path.bounces >= kMostBounces || !Wave::sampled(path.place, samples, next)) return false;
  path.spread |= path.caustics != nullptr;  // no lobe of theirs is sharp then
  return goOn(
      path, next,
      {false, lanes.leavesFront(next.direction, lane), PlainLanes::vector(lanes.normal, lane)});
}

bool PathTracer::goOn(WavePath& path, const BsdfSample& next, const Turning& how) const {
  path.throughput *= next.weight;
  path.roulette *= next.etaSquared;
  if (path.bounces >= kRouletteFrom && !path.look) {
    // The square root costs a tenth more rays and takes more than that of the noise.
    const float survival =
        std::min(0.95f, std::sqrt(maxComponent(path.throughput) * path.roulette));
    if (!(survival > 0.0f) || path.sampler.next1D() >= survival) return false;
    path.throughput /= survival;
  }
  if (!(maxComponent(path.throughput) > 0.0f)) return false;
  path.certain &= how.alone;
  if (!rays_.leave(path.surface, next.direction, how.front, path.start)) return false;
  if (next.delta && next.transmitted && ClearLayers::clear(*path.bsdf)) {
    passClear(path, next.direction);
  } else {
    if (++path.turns > scene_.maxBounces) return false;
    path.turn(how.normal);
    path.scatterPdf = next.delta ? kInfinity : next.pdf;
    if (!next.delta) ++path.scattered;
    path.roughness = next.roughness;
    path.coneRay = path.coneVertex && !next.delta;
  }
  path.direction = next.direction;
  path.tnear = 0.0f;
  if (next.transmitted) {
    path.absorption = path.bsdf->absorptionTowards(next.direction, path.absorption);
  }
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
