#include "src/paths/path_tracer.h"

#include <algorithm>

#include "src/paths/wave.h"

namespace trex {

PathTracer::PathTracer(const Scene& scene, const RayScene& rays, const LightSet& lights,
                       const CameraRays& camera, const GuessOptions& guess, std::uint32_t seed,
                       bool background, const CausticMaps* caustics)
    : scene_(scene),
      rays_(rays),
      lights_(lights),
      camera_(camera),
      media_(rays.media()),
      guess_(guess),
      seed_(seed),
      background_(background),
      layers_(scene, rays),
      caustics_(caustics),
      // Media add light on the way, and paths that wait for pages go on by themselves. Of sharp
      // lobes caustics take their part.
      plain_(media_ == nullptr && rays.parts().paged == nullptr
                 ? PlainSurfaces(scene, rays, caustics != nullptr ? kSharpAlpha : kClearAlpha)
                 : PlainSurfaces::none(scene, rays)) {}

void PathTracer::trace(std::span<const PathJob> jobs, std::uint32_t width, std::uint32_t first,
                       std::span<PathSample> samples, std::span<RayCounts> counts,
                       Cones& cones) const {
  Wave wave(cones);
  for (std::size_t i = 0; i < jobs.size(); i += Wave::kPaths) {
    wave.paths.clear();
    for (std::size_t k = i; k < std::min(jobs.size(), i + Wave::kPaths); ++k) {
      Sampler sampler(jobs[k].y * width + jobs[k].x, jobs[k].sample, seed_);
      const PathState state = generate(jobs[k], first + static_cast<std::uint32_t>(k), sampler);
      const WavePath& path = enter(wave, state, sampler, samples[k], counts[k]);
      if (path.paired) ++path.counts->exactPaths;
    }
    extendFirst(wave);
    run(wave);
  }
}

void PathTracer::resume(std::span<const PathState> paths, std::span<PathSample> samples,
                        std::span<RayCounts> counts) const {
  Cones none;
  Wave wave(none);
  for (std::size_t i = 0; i < paths.size(); i += Wave::kPaths) {
    wave.paths.clear();
    wave.underWay.clear();
    for (std::size_t k = i; k < std::min(paths.size(), i + Wave::kPaths); ++k) {
      const PathState state = paths[k].resumed();
      wave.underWay.push_back(&enter(wave, state, Sampler(state.random), samples[k], counts[k]));
    }
    std::erase_if(wave.underWay, [&](WavePath* path) { return !extend(*path, wave); });
    run(wave);
  }
}

WavePath& PathTracer::enter(Wave& wave, const PathState& state, const Sampler& sampler,
                            PathSample& sample, RayCounts& counts) const {
  WavePath& path = wave.paths.emplace_back(state, sampler);
  path.sample = &sample;
  path.counts = &counts;
  path.caustics = caustics_ ? caustics_->find(path.number) : nullptr;
  return path;
}

PathSample PathTracer::sample(const PathJob& job, std::uint32_t width) const {
  PathSample sample;
  RayCounts counts;
  Cones cones;
  trace({&job, 1}, width, 0, {&sample, 1}, {&counts, 1}, cones);
  return sample;
}

/// Whether a sample's far field is for cones. Drawn apart from all else that its number decides,
/// so that pairs (takesExact()) have as many of both kinds as other samples.
bool PathTracer::byCones(const PathJob& job) const {
  const double share = coneShare();
  if (share <= 0.0 || share >= 1.0) return share > 0.0;
  const std::uint32_t pixel = hashCombine(hashCombine(seed_ ^ 0x636f6e65u, job.y), job.x);
  return static_cast<double>(toUnitFloat(hashCombine(pixel, job.sample))) < share;
}

/// A path and its first ray.
PathState PathTracer::generate(const PathJob& job, std::uint32_t number, Sampler& sampler) const {
  PathState path{.job = number,
                 .number = job.sample,
                 .paired = job.paired,
                 .look = job.look,
                 .certain = media_ == nullptr && !camera_.hasLens(),
                 .byRays = !byCones(job)};
  const vec2 jitter = sampler.next2D();
  camera_.ray(static_cast<float>(job.x) + jitter.x, static_cast<float>(job.y) + jitter.y,
              path.start.position, path.direction);
  if (camera_.hasLens()) {
    camera_.throughLens(sampler.next2D(), path.start.position, path.direction);
  }
  path.random = sampler.state();
  return path;
}

/// All paths of a wave whose surface is known through all stages, until the last one has ended.
void PathTracer::run(Wave& wave) const {
  while (!wave.underWay.empty()) {
    decode(wave);
    std::erase_if(wave.underWay, [&](WavePath* path) {
      path->fate = path->isPlain() ? arrivePlain(*path, wave) : arrive(*path);
      return path->fate == Fate::kEnds;
    });
    ask(wave);
    for (WavePath* path : wave.underWay) {
      if (path->fate == Fate::kLit) answer(*path, wave);
    }
    scatter(wave);
    std::erase_if(wave.underWay, [&](WavePath* path) { return !extend(*path, wave); });
  }
}

}  // namespace trex
