// What paths are asked for, and what they bring.
#pragma once

#include <cstdint>

#include "src/core/maths.h"
#include "src/frame/features.h"

namespace trex {

/// A sample to take: number `sample` of pixel (x, y). `paired` asks for X as well; without a cache
/// X is all there is and goes to `common`.
/// A look ends where it knows its `feature`: its `common` is what is seen of emitters up to there.
/// It leaves nothing to chance at glass: at the first face of it even numbers see what is seen
/// most, behind it or in it, odd ones the other; at the second each second number of both does;
/// after that all see what is seen most. PathSample::weight says in what proportion.
struct PathJob {
  std::uint32_t x, y, sample;
  bool paired = false;
  bool look = false;
};

/// One sample of a pixel. G = common + guess + cones; X = common + exact. The parts of both that
/// are direct: light that was scattered at most once, mirrors and clear glass not counted.
struct PathSample {
  vec3 common{0.0f}, guess{0.0f}, exact{0.0f};
  vec3 direct{0.0f}, directExact{0.0f};  ///< of G (without cones) and of X
  /// Of `common`: what emitters, unlit surfaces and the sky send to the eye, straight or by mirrors
  /// alone. Nothing about it is left to chance, so no filter may touch it.
  vec3 own{0.0f};
  vec3 photonNoise{0.0f};  ///< of `guess`, a picture of it: CachedLight::noisyIrradiance()
  std::uint8_t lot = 0;    ///< which of those is asked for
  Feature feature;
  FirstHit first;
  /// 1 where the camera's ray meets a surface, glass included; of a blended or masked one the share
  /// of samples that it stops. Else the opacity of the media on its way to the background.
  float alpha = 1.0f;
  float weight = 1.0f;  ///< of a look; of four in a row the mean is 1
};

/// Rays by class, for the report.
struct RayCounts {
  std::uint64_t cRays = 0, shadowRays = 0, cones = 0, cacheReads = 0, exactPaths = 0;
  std::uint64_t deviceCones = 0;  ///< of the cones, answered by a device; of whole batches alone
  void add(const RayCounts& o) {
    cRays += o.cRays;
    shadowRays += o.shadowRays;
    cones += o.cones;
    cacheReads += o.cacheReads;
    exactPaths += o.exactPaths;
    deviceCones += o.deviceCones;
  }
  /// Those that came since `before`.
  RayCounts since(const RayCounts& o) const {
    return {cRays - o.cRays,           shadowRays - o.shadowRays, cones - o.cones,
            cacheReads - o.cacheReads, exactPaths - o.exactPaths, deviceCones - o.deviceCones};
  }
};

}  // namespace trex
