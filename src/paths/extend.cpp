#include "src/paths/path_tracer.h"

#include <array>
#include <span>

#include "src/paths/wave.h"

namespace trex {

/// Traces the first rays of all paths, neighbours from one eye, as one span. Those that meet
/// nothing end.
void PathTracer::extendFirst(Wave& wave) const {
  std::array<RayQuery, Wave::kPaths> rays;
  std::array<RayHit, Wave::kPaths> hits;
  std::array<std::uint8_t, Wave::kPaths> met;
  const std::size_t count = wave.paths.size();
  for (std::size_t i = 0; i < count; ++i) {
    const WavePath& path = wave.paths[i];
    rays[i] = {path.start, path.direction, path.tnear, kInfinity};
  }
  rays_.intersect(std::span(rays).first(count), hits, met);
  wave.underWay.clear();
  for (std::size_t i = 0; i < count; ++i) {
    WavePath& path = wave.paths[i];
    ++path.counts->cRays;
    path.hit = hits[i];
    if (met[i]) {
      wave.underWay.push_back(&path);
    } else {
      miss(path);
    }
  }
}

/// Traces the ray to the next surface. False if the path has left the scene or a cone goes on in
/// its place.
bool PathTracer::extend(WavePath& path, Wave& wave) const {
  const NextRay next = nextRay(path);
  const bool met = rays_.intersect(path.start, path.direction, path.tnear, next.end, path.hit);
  return takeHit(path, wave, next, met);
}

/// How far the next ray is traced, and whether a cone may go on beyond the near field.
NextRay PathTracer::nextRay(const WavePath& path) const {
  bool cone = path.coneRay && path.coupled && !path.byRays && !path.clear.begun();
  // Voxels know nothing of media: a cone whose axis meets one is an exact ray into cached light.
  if (media_ != nullptr && cone) {
    cone = !media_->meets(path.start.position, path.direction, path.tnear, kInfinity);
  }
  // Nor of clear glass: so it is with a cone whose axis meets that first.
  return {cone, !cone || layers_.glass() ? kInfinity : nearField()};
}

/// What the next ray has met, `path.hit`, or that it met nothing as far as it went.
bool PathTracer::takeHit(WavePath& path, Wave& wave, const NextRay& next, bool met) const {
  ++path.counts->cRays;
  bool cone = next.cone;
  const bool whole = next.end == kInfinity;
  const float near = nearField();
  if (met && cone && whole) {
    cone = path.hit.t > near &&
           !(layers_.glass() && layers_.isGlass(rays_.surface(path.hit).material));
    if (!cone) return true;
  }
  if (cone && !(met && path.hit.t <= near)) {
    path.tnear = near;
    if (!handToCone(path, wave)) return false;
    if (!whole) met = rays_.intersect(path.start, path.direction, near, kInfinity, path.hit);
  }
  if (!met) miss(path);
  return met;
}

void PathTracer::miss(WavePath& path) const {
  if (media_ != nullptr) passMedia(path, kInfinity);
  if (path.bounces == path.layers) {  // nothing but transparent layers and media on the way
    path.sample->alpha = 1.0f - path.throughput.x;
    if (!background_) return;
  }
  if (!lights_.hasEnvironment()) return;
  const float weight =
      powerHeuristic(path.density(), lights_.pdfEnvironment(path.lastPoint(), path.aim()));
  path.addSeen(path.throughput * lights_.environment(path.direction) * weight);
}

/// G0: the far field of a broad lobe is a cone's. False if only the guess was asked for.
bool PathTracer::handToCone(WavePath& path, Wave& wave) const {
  ConeRequest request;
  request.origin = vec3(path.start.position);
  request.direction = path.direction;
  request.tanHalf = guess_.footprint.spread(path.roughness);
  request.tmin = path.tnear;
  request.jitter = path.sampler.next1D();
  request.weight = path.throughput * cachedShare(request.origin, path.turns);
  request.job = path.job;
  request.bounce = path.bounces;
  if (lights_.hasEnvironment()) {
    const float weight =
        powerHeuristic(path.scatterPdf, lights_.pdfEnvironment(path.lastPoint(), path.direction));
    request.background = path.throughput * lights_.environment(path.direction) * weight;
    request.direct = path.scattered <= 1;
  }
  request.path = static_cast<std::uint32_t>(wave.cones.paths.size());
  wave.cones.paths.push_back(path);
  wave.cones.paths.back().random = path.sampler.state();
  wave.cones.requests.push_back(request);
  ++path.counts->cones;
  return path.part();
}

/// Metres from a surface that are its near field: no cone starts there.
float PathTracer::nearField() const {
  return guess_.cache ? guess_.footprint.cacheVoxels * guess_.cache->leafSize() /
                            guess_.footprint.diffuseSpread
                      : 0.0f;
}

}  // namespace trex
