// C-rays: a path tracer with light sampling, multiple importance sampling and Russian roulette
// [Veach 1997], which is the exact side X, and the ladder of guesses on top of it.
//
// Paths are data (path_state.h) and go in waves through stages, each in one file:
//
//   generate ─► extend ─► decode ─► arrive ─► ask ─► answer ─► scatter ─┐
//                 ▲ trace surface   cache     choose shadow    next     │
//                 │                           light  ray       ray      │
//                 └─────────────────────────────────────────────────────┘
//
// As long as guess and exact path agree a path's light is `common`. Where the footprint rule lets a
// ray end in cached light (G1) or hands it to a cone (G0), the guess leaves the path: what it adds
// goes to `guess` (and to cone requests); if the sample is paired, the path goes on and adds to
// `exact`.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/crays/bsdf.h"
#include "src/crays/camera_rays.h"
#include "src/crays/clear_path.h"
#include "src/crays/light_cache.h"
#include "src/crays/lights.h"
#include "src/crays/ray_scene.h"
#include "src/paths/caustics.h"
#include "src/paths/cones.h"
#include "src/paths/path_sample.h"
#include "src/paths/plain_wave.h"

namespace trex {

enum class Fate : std::uint8_t;
struct AskedLight;
struct LightAnswer;
struct MediumLight;
struct NextRay;
struct PathState;
struct Turning;
struct WaitingLight;
struct WaitingRay;
struct Wave;
struct WavePath;

/// What a path may do besides tracing exactly.
struct GuessOptions {
  const CachedLight* cache = nullptr;  ///< null: exact paths alone
  FootprintRule footprint;
  bool noise = false;  ///< PathSample::photonNoise is asked for
  /// Of the samples, [0, 1]: those whose far field is gathered by cones (G0, and shadow cones). The
  /// others follow rays into cached light. Which ones is drawn from pixel, number and seed.
  double coneShare = 0.0;
  float shadowSolidAngle = 0.02f;  ///< of the sky, from which on a shadow ray is a G-ray, sr
};

/// Immutable; trace() is thread safe.
class PathTracer {
 public:
  /// All of these must outlive it. `background`: rays of the camera that meet nothing see the
  /// environment. `caustics` (may be null) must have prepared the maps of the samples that read
  /// them.
  PathTracer(const Scene& scene, const RayScene& rays, const LightSet& lights,
             const CameraRays& camera, const GuessOptions& guess, std::uint32_t seed,
             bool background = true, const CausticMaps* caustics = nullptr);

  /// Traces samples of a picture `width` pixels wide. samples[i] and counts[i] are of jobs[i], as
  /// large and empty; cone requests are appended, with `first` + i. Samples depend on pixel, number
  /// and seed alone, not on what is traced with them. Throws as RayScene::intersect() does.
  void trace(std::span<const PathJob> jobs, std::uint32_t width, std::uint32_t first,
             std::span<PathSample> samples, std::span<RayCounts> counts, Cones& cones) const;
  /// Goes on with paths in the place of cones that did not know (Cones::paths), by rays alone.
  /// What a guess gets of samples[i]: common + guess, and direct. samples[i] and counts[i] are of
  /// paths[i], as large and empty. Throws as RayScene::intersect() does.
  void resume(std::span<const PathState> paths, std::span<PathSample> samples,
              std::span<RayCounts> counts) const;
  /// One of them, without what cones would add to the guess.
  PathSample sample(const PathJob& job, std::uint32_t width) const;
  /// Whether samples are guesses, so that a paired one differs.
  bool guesses() const { return guess_.cache != nullptr; }
  /// Of the samples, whose far field is gathered by cones.
  double coneShare() const { return guesses() ? guess_.coneShare : 0.0; }

 private:
  friend class BatchedTracer;  // another way through the same stages: batched_tracer.h

  bool byCones(const PathJob& job) const;
  PathState generate(const PathJob& job, std::uint32_t number, Sampler& sampler) const;
  WavePath& enter(Wave& wave, const PathState& state, const Sampler& sampler, PathSample& sample,
                  RayCounts& counts) const;
  void run(Wave& wave) const;

  void extendFirst(Wave& wave) const;
  bool extend(WavePath& path, Wave& wave) const;
  NextRay nextRay(const WavePath& path) const;
  bool takeHit(WavePath& path, Wave& wave, const NextRay& next, bool met) const;
  bool handToCone(WavePath& path, Wave& wave) const;
  void miss(WavePath& path) const;

  void decode(Wave& wave) const;
  const Bsdf& bsdfOf(WavePath& path) const;
  Fate arrive(WavePath& path) const;
  Fate arrivePlain(WavePath& path, const Wave& wave) const;
  bool passLayer(WavePath& path) const;
  void meet(WavePath& path) const;
  void look(WavePath& path) const;
  void see(WavePath& path, const vec3& albedo, const vec3& normal) const;
  void emit(WavePath& path) const;
  bool endInCache(WavePath& path, const vec3& side, const vec3* albedo) const;
  bool handsToCones(const WavePath& path, bool cacheable) const;
  bool mayEndAfter(std::uint32_t turns) const;
  float cachedShare(const vec3& position, std::uint32_t turns) const;

  void ask(Wave& wave) const;
  void ask(WavePath& path, Wave& wave) const;
  bool askLight(WavePath& path, Wave& wave) const;
  bool askPlain(WavePath& path, Wave& wave, const PlainValues& values) const;
  bool asksRay(WavePath& path, Wave& wave) const;
  void shadowCone(WavePath& path, const vec3& radiance, Wave& wave) const;
  void answer(WavePath& path, const PlainWave& wave) const;
  void takeAnswer(WavePath& path) const;
  vec3 causticLight(WavePath& path, const PlainWave& wave) const;
  vec3 absorptionOf(const WavePath& path) const;
  AskedLight asked(const WavePath& path) const;
  bool answerHere(WaitingLight& light, WaitingRay& ray, LightAnswer& answer) const;
  LightConnection throughMedia(LightConnection way, const RayStart& start, const vec3& direction,
                               const RayEnd& end) const;
  LightConnection connect(WavePath& path, const RayStart& start, const vec3& direction,
                          const RayEnd& end, const vec3& absorption) const;
  bool asksEmitter(const WavePath& path, const RayHit& hit, RayQuery& query) const;
  float emitterWeight(float density, const RayStart& left, const LightPoint& vertex,
                      const ClearPath& way, float travelled, const vec3& direction,
                      const Surface& surface, const RayHit& hit,
                      const LightConnection* connection) const;

  void passMedia(WavePath& path, float distance) const;
  void drawMedium(WavePath& path, float distance, MediumLight& light) const;
  bool lightMedium(MediumLight& light, WaitingRay* waits) const;
  bool lightAlong(MediumLight& light, WaitingRay* waits) const;

  void scatter(Wave& wave) const;
  bool scatter(WavePath& path) const;
  bool scatterPlain(WavePath& path, const Wave& wave, const PlainWave::Samples& samples) const;
  bool goOn(WavePath& path, const BsdfSample& next, const Turning& how) const;
  void passClear(WavePath& path, const vec3& direction) const;

  float nearField() const;

  const Scene& scene_;
  const RayScene& rays_;
  const LightSet& lights_;
  const CameraRays& camera_;
  const Media* media_;  ///< null if there is none
  GuessOptions guess_;
  std::uint32_t seed_;
  bool background_;
  ClearLayers layers_;
  const CausticMaps* caustics_;
  PlainSurfaces plain_;
};

}  // namespace trex
