#include "src/paths/path_tracer.h"
#include "src/paths/wave.h"

namespace trex {

/// Decodes the surfaces that were hit: plain ones into lanes, which are shaded together.
void PathTracer::decode(Wave& wave) const {
  wave.plainCount = 0;
  for (WavePath* path : wave.underWay) {
    path->bsdf.reset();
    path->place = plain_.decode(path->hit, path->direction, wave, path->surface);
    if (!path->isPlain()) path->surface = rays_.surface(path->hit);
    const bool reads = !path->isPlain() || plain_.textured(path->surface.material);
    if (reads) prefetchTextures(scene_, path->surface);
  }
  if (wave.plainCount == 0) return;
  for (const WavePath* path : wave.underWay) {
    if (path->isPlain()) plain_.colour(path->place, path->surface, wave);
  }
  plain_.shade(wave);
  for (WavePath* path : wave.underWay) {
    if (!path->isPlain() || plain_.finish(path->place, wave, path->surface)) continue;
    path->place = PlainWave::kNotPlain;
    path->surface = rays_.surface(path->hit);
  }
}

/// That of any surface, for what is asked too seldom to be done in lanes.
const Bsdf& PathTracer::bsdfOf(WavePath& path) const {
  if (!path.bsdf) path.bsdf.emplace(scene_, rays_.surface(path.hit), -path.direction);
  return *path.bsdf;
}

}  // namespace trex
