// Samples as they enter a frame: what paths and the device's answers bring to a pixel's sums, and
// no more. Plain data, so that they can be taken on another machine.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "src/frame/features.h"
#include "src/paths/path_sample.h"
#include "src/session/shot_photons.h"

namespace trex {

class Session;

/// One sample of a pixel.
struct TakenSample {
  vec3 guess{0.0f}, exact{0.0f};  ///< G, and X if it is paired
  vec3 light{0.0f};               ///< of G, what a filter may touch
  Feature feature;
  FirstHit first;
  float alpha = 1.0f;
  vec3 direct{0.0f}, directExact{0.0f};  ///< the direct parts of G and X
  vec3 photonNoise{0.0f};                ///< of G
  std::uint32_t rays = 0;                ///< C-rays, shadow rays and cones: what it cost
  std::uint32_t cRays = 0, gRays = 0;    ///< C-rays with shadow rays; cones with reads of light
  bool paired = false;
};

/// Samples of several units (scheduler.h) in their order, each unit's pixels row by row.
struct TakenSamples {
  std::vector<TakenSample> samples;
  RayCounts rays;  ///< of all together
};

/// Takes a session's samples together with others, instead of the session alone; and shoots its
/// photons, which the others, who need them too, wait for.
class SampleSharer : public PhotonSharer {
 public:
  /// The session makes the light of `photons` photons now; samples will read it.
  virtual void lightComes(const Session& session, std::uint64_t photons) = 0;
  /// Adds samples to the session's frame until its tiles stand at their barrier, or keepGoing says
  /// no.
  virtual void take(Session& session, const std::function<bool()>& keepGoing) = 0;
};

}  // namespace trex
