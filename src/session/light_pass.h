// Photons, progressively: before some samples more of them are shot, the voxels' light is resolved,
// and the guess reads it from then on.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "src/crays/camera_rays.h"
#include "src/crays/light_cache.h"
#include "src/grays/grays.h"
#include "src/session/shot_photons.h"

namespace trex {

/// Photons that should have been emitted before sample number `sample` of a picture of `pixels`
/// pixels. Depends on nothing else, so that equal samples see equal light; constant between powers
/// of four, so that resolving costs little; about a third of the work of gathering.
std::uint64_t photonTarget(std::uint32_t sample, std::uint64_t pixels);

class LightPass {
 public:
  /// Seconds of photons between two questions whether to go on: the longer, the less time is lost
  /// where all threads wait for each other. Of a screen, and of captures.
  static constexpr double kShortSlice = 0.003, kSlice = 0.02;

  /// `rayBounces`: photons bounce as C-rays, and the device only adds up where they land. They do
  /// so in a scene with media or where bounces have an end, whatever is said here: voxels know of
  /// neither.
  LightPass(const Scene& scene, const WalkTracer& walks, const LightSet& lights, GRayTracer& device,
            LightCache& cache, std::uint32_t seed, bool rayBounces, double slice = kShortSlice);

  /// Photons of outside sources shall go where this camera's picture of width x height needs light.
  /// To be called before the first run(); without it they start uniformly. Costs some ms, and
  /// nothing if no source shines from outside.
  void aim(const CameraRays& camera, std::uint32_t width, std::uint32_t height);

  /// To be called before the first run(): the light is to tell how noisy it is by lots of photons.
  void tellLots();

  /// From now on photons are shot together with other machines; it outlives this.
  void share(PhotonSharer* sharer) { sharer_ = sharer; }

  /// Shoots what is missing up to `target` photons in all and resolves. Asks `keepGoing` after each
  /// slice; false if it said no: the light is then as it was, and the next call goes on. The
  /// light depends on the number of photons alone, not on the calls that brought them. Where flux
  /// is lost with a device the same are shot again, and the light of before stays until then.
  /// Photons that wait for pages may take a minute: `giveUp`, asked by all threads meanwhile, ends
  /// it as keepGoing does, and so does a page that they miss where rays do not wait.
  bool run(std::uint64_t target, const std::function<bool()>& keepGoing,
           const std::function<bool()>& giveUp = {});

  /// The device's sums are to be forgotten by whoever makes a new pass.
  std::uint64_t emitted() const { return emitted_; }
  /// Photons that the cached light knows of; 0: none is ready.
  std::uint64_t resolved() const { return resolved_; }
  /// Whether photons are aimed at a camera.
  bool guided() const { return !guides_.empty(); }
  bool rayBounces() const { return rayBounces_; }
  std::uint64_t landed() const { return landed_; }
  /// Landings of photons from outside where aim() found light to be wanted.
  std::uint64_t wanted() const { return wanted_; }
  double seconds() const { return seconds_; }
  /// W/m^2 in one unit of the device's irradiance: the mean over the scene's sphere, so that the
  /// stored half-precision values lie around one whatever the lights' power.
  double scale() const { return scale_; }

 private:
  std::uint64_t boundary() const;
  std::optional<ShotPhotons> land(std::uint64_t first, std::uint64_t count,
                                  const std::function<bool()>& giveUp) const;
  std::optional<ShotPhotons> landTogether(std::uint64_t count,
                                          const std::function<bool()>& keepGoing,
                                          const std::function<bool()>& giveUp);
  bool shoot(std::uint64_t count, const std::function<bool()>& keepGoing,
             const std::function<bool()>& giveUp);
  bool noticeLoss();

  const Scene& scene_;
  const WalkTracer& walks_;
  const LightSet& lights_;
  GRayTracer& device_;
  LightCache& cache_;
  std::uint32_t seed_;
  bool rayBounces_;
  PhotonSharer* sharer_ = nullptr;  ///< not ours
  double scale_ = 1.0, unit_ = 1.0, seconds_ = 0.0;
  std::uint64_t emitted_ = 0, landed_ = 0, wanted_ = 0;
  int losses_ = 0;                       ///< GRayTracer::fluxLosses() of before
  std::uint64_t resolved_ = 0;           ///< photons that the cache knows of
  LotSums lots_;                         ///< counts if asked to
  TurnSums turns_;                       ///< counts where Scene::maxBounces has an end
  double slice_;                         ///< seconds
  std::uint64_t chunk_;                  ///< photons that take about a slice here
  std::vector<PhotonLesson> unlearned_;  ///< of the batch under way
  ImportanceMap importance_;
  std::vector<EmissionGuide> guides_;  ///< by source; none if nothing is to be guided
  std::vector<EmissionGuide> hints_;   ///< guides before they learn from photons
};

}  // namespace trex
