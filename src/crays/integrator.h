// The C-ray integrator: a path tracer with light sampling, multiple importance sampling and Russian
// roulette [Veach 1997], which is the exact side X, and the ladder of guesses on top of it.
//
// A path is traced once. As long as guess and exact path agree its light is `common`. Where the
// footprint rule lets a ray end in cached light (G1) or hands it to a cone (G0), the guess leaves
// the path: what it adds goes to `guess` (and to cone requests); if the sample is paired, the path
// goes on and adds to `exact`.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "src/core/sampler.h"
#include "src/crays/bsdf.h"
#include "src/crays/caustics.h"
#include "src/crays/clear_path.h"
#include "src/crays/light_cache.h"
#include "src/crays/lights.h"
#include "src/crays/ray_scene.h"
#include "src/frame/features.h"

namespace trex {

/// A camera in render space, ready to make rays.
class CameraRays {
 public:
  CameraRays(const Camera& camera, const dvec3& renderOrigin, std::uint32_t width,
             std::uint32_t height);
  /// Ray through image position (x, y) in pixels from the upper left corner.
  void ray(float x, float y, dvec3& origin, vec3& direction) const;
  bool hasLens() const { return lensRadius_ > 0.0f; }
  /// Moves such a ray to a place of the lens, u in [0, 1)^2; it still meets the plane of focus at
  /// the same point.
  void throughLens(vec2 u, dvec3& origin, vec3& direction) const;
  /// Distance of a point along the viewing direction, metres.
  float depth(const dvec3& point) const { return glm::dot(vec3(point - eye_), forward_); }
  /// Width of a pixel after `distance` metres, metres; of what it mixes where a lens blurs.
  float footprint(float distance) const {
    const float sharp = (orthographic_ ? 1.0f : distance) * 2.0f * halfHeight_ / height_;
    return hasLens() ? sharp + 2.0f * lensRadius_ * std::abs(distance - focus_) / focus_ : sharp;
  }

 private:
  dvec3 eye_;
  vec3 forward_, right_, up_;
  float halfWidth_, halfHeight_, width_, height_, lensRadius_, focus_;
  bool orthographic_;
};

/// A G-ray that a path asks for. The answer adds to the guess of its pixel:
/// weight * radiance + background * transmittance.
struct ConeRequest {
  vec3 origin, direction;
  float tanHalf = 0.0f, tmin = 0.0f, tmax = kInfinity;
  float jitter = 0.0f;
  vec3 weight{0.0f}, background{0.0f};
  std::uint32_t pixel = 0;  ///< as given to Integrator::sample
  bool shadow = false;      ///< transmittance alone
  bool direct = false;      ///< `background` is direct light
};

/// One sample of a pixel. G = common + guess + cones; X = common + exact. The parts of both that
/// are direct: light that was scattered at most once, mirrors and clear glass not counted.
struct PathSample {
  vec3 common{0.0f}, guess{0.0f}, exact{0.0f};
  vec3 direct{0.0f}, directExact{0.0f};  ///< of G (without cones) and of X
  /// Of `common`: what emitters, unlit surfaces and the sky send to the eye, straight or by mirrors
  /// alone. Nothing about it is left to chance, so no filter may touch it.
  vec3 own{0.0f};
  Feature feature;
  FirstHit first;
  /// 1 where the camera's ray meets a surface, glass included; of a blended or masked one the share
  /// of samples that it stops. Else the opacity of the media on its way to the background.
  float alpha = 1.0f;
};

/// Rays by class, for the report.
struct RayCounts {
  std::uint64_t cRays = 0, shadowRays = 0, cones = 0, cacheReads = 0, exactPaths = 0;
  void add(const RayCounts& o) {
    cRays += o.cRays;
    shadowRays += o.shadowRays;
    cones += o.cones;
    cacheReads += o.cacheReads;
    exactPaths += o.exactPaths;
  }
};

/// What a path may do besides tracing exactly.
struct GuessOptions {
  const LightCache* cache = nullptr;  ///< null: exact paths alone
  FootprintRule footprint;
  bool cones = false;              ///< G0 and shadow cones are worth their cost on this device
  float shadowSolidAngle = 0.02f;  ///< steradian from which on a shadow ray is a G-ray
};

/// Immutable; sample() is thread safe.
class Integrator {
 public:
  /// `background`: rays of the camera that meet nothing see the environment. `caustics` (may be
  /// null) must have prepared the maps of the samples that read them.
  Integrator(const Scene& scene, const RayScene& rays, const LightSet& lights,
             const CameraRays& camera, const GuessOptions& guess, std::uint32_t seed,
             bool background = true, const CausticMaps* caustics = nullptr);

  /// Traces sample number `sample` of pixel (x, y). `paired` asks for X as well; without a cache X
  /// is all there is and goes to `common`. Cone requests are appended with `pixelTag`.
  PathSample sample(std::uint32_t x, std::uint32_t y, std::uint32_t width, std::uint32_t sample,
                    bool paired, std::uint32_t pixelTag, std::vector<ConeRequest>& cones,
                    RayCounts& counts) const;
  /// Whether samples are guesses, so that a paired one differs.
  bool guesses() const { return guess_.cache != nullptr; }

 private:
  struct Path;
  bool advance(Path& path) const;
  bool meet(Path& path) const;
  void passMedia(Path& path, float distance) const;
  vec3 scatteredLight(Path& path, const dvec3& point, float anisotropy) const;
  void miss(Path& path) const;
  bool endInCache(Path& path, const Surface& surface, const Bsdf& bsdf) const;
  void sampleLight(Path& path, const Surface& surface, const Bsdf& bsdf, bool coneVertex) const;
  bool scatter(Path& path, const Surface& surface, const Bsdf& bsdf, bool coneVertex) const;
  bool handToCone(Path& path) const;
  vec3 lightAlong(Path& path, const dvec3& point, const vec3& direction, float pdf) const;
  float nearField() const;
  LightConnection connect(Path& path, const RayStart& start, const vec3& direction,
                          const RayEnd& end, const vec3& absorption) const;
  void shadowCone(Path& path, const RayStart& start, const LightSample& light,
                  const vec3& radiance) const;
  float emitterWeight(float density, const RayStart& left, const LightPoint& vertex,
                      const ClearPath& way, float travelled, const vec3& direction,
                      const Surface& surface, const RayHit& hit) const;
  void passClear(Path& path, const Bsdf& bsdf, const vec3& direction) const;

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
};

}  // namespace trex
