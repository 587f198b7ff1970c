// The approximate light of a session: voxels, the device that traces in them, their photons, and
// the cache that samples read. One state says what of it is valid, and so what comes next:
//
//          await()    setVoxels()  renew()     renew()      renew()        shoot()
//   kAbsent ───► kAwaited ───► kValues ───► kDevice ───► kPhotons ───► kShooting ───► kReady
//                                 ▲                         ▲                          │
//                                 └── invalidate(kValues) ──┴── invalidate(kPhotons) ──┘
//
// New voxels take the place of those of before once photons have been shot in them; until then
// previews read the old ones. One thread at a time; what samples read does not change meanwhile.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "asvo/asvo.h"
#include "src/crays/light_cache.h"
#include "src/grays/grays.h"
#include "src/session/light_pass.h"
#include "src/session/model.h"
#include "src/session/settings.h"

namespace trex {

/// The device of the settings, ready to trace in `tree`. By any thread. Throws Error.
std::unique_ptr<GRayTracer> makeLightDevice(const std::vector<Material>& materials,
                                            const std::vector<Image>& images,
                                            const asvo::Tree& tree, const RenderSettings& settings);

class VoxelLight {
 public:
  /// In the order of what has to be done: all before it is valid, all from it on is not.
  enum class State : std::uint8_t {
    kAbsent,    ///< there are no voxels and none will come: samples are exact
    kAwaited,   ///< voxels are being built
    kValues,    ///< they need the values of edited materials
    kDevice,    ///< the device must read them
    kPhotons,   ///< photons must start anew
    kShooting,  ///< photons are on their way
    kReady,     ///< samples may read it; more photons make it finer
  };

  /// Keeps seed, kind and least number of photons, and their aim.
  explicit VoxelLight(const RenderSettings& settings);

  State state() const { return state_; }
  /// Voxels are being built; setVoxels() will bring them.
  void await() { state_ = State::kAwaited; }
  /// Voxels, and a device that reads them. `next`: kValues, or kPhotons if their values are right.
  void setVoxels(std::shared_ptr<const asvo::Tree> tree, std::unique_ptr<GRayTracer> device,
                 State next);
  /// Nothing from `from` on is valid any longer. Of no effect where there are no voxels.
  void invalidate(State from);
  /// Called in kValues; gives the voxels the values of the present materials.
  void setValues(std::function<void()> action) { setValues_ = std::move(action); }

  /// Does what kValues, kDevice or kPhotons asks for, and goes on to the next state. Photons of
  /// `lights` are aimed at aim(), or else at `view`, of width x height pixels. `walks`, which must
  /// outlive it, will trace them. Some ms at most, unless walks wait for pages.
  void renew(const Model& model, const WalkTracer& walks, const LightSet& lights,
             const Camera& view, std::uint32_t width, std::uint32_t height);
  /// Shoots what is missing up to `photons` in all: see LightPass::run(). True, and kReady, if
  /// keepGoing let it. In kShooting and kReady. `before`, fewer: how many of them tell the noise of
  /// all (LightCache::setLight()); 0: those of now.
  bool shoot(std::uint64_t photons, const std::function<bool()>& keepGoing,
             std::uint64_t before = 0);
  /// Photons that start from now on are shot together with other machines; it outlives this.
  void share(PhotonSharer* sharer) { sharer_ = sharer; }
  bool shared() const { return sharer_ != nullptr; }
  /// Asked by any thread while photons wait for pages: LightPass::run().
  void setGiveUp(std::function<bool()> ask) { giveUp_ = std::move(ask); }

  /// Photons that the cached light knows of; 0: none is ready.
  std::uint64_t photons() const { return present_.pass ? present_.pass->resolved() : 0; }
  bool guided() const { return present_.pass && present_.pass->guided(); }
  /// How often photons have started anew: the same number, the same light.
  std::uint32_t number() const { return number_; }
  /// How captures repeat this light: RenderSettings::photons and aim.
  std::uint64_t leastPhotons() const { return leastPhotons_; }
  const std::optional<Camera>& aim() const { return aim_; }
  /// The present photons serve another frame: it asks for as many from its first sample on.
  void keepPhotons() { leastPhotons_ = photons(); }
  /// The next photons go where this camera looks, and as many as its samples ask for.
  void aimAt(const Camera& view);

  // What samples and previews read; null where there is none. Before kReady: of before.
  const LightCache* cache() const { return shown().cache.get(); }
  GRayTracer* device() { return shown().device.get(); }
  const asvo::Tree* voxels() const { return shown().tree.get(); }
  /// The cache has light, of whatever time.
  bool hasLight() const { return cache() != nullptr && cache()->hasLight(); }
  /// Makes it so many times as strong: a preview of changed lights.
  void scaleBy(double factor) {
    if (shown().cache) shown().cache->scaleLight(factor);
  }
  /// Cached light on the side of `normal`, W/m^2; false if there is none.
  bool at(const vec3& position, const vec3& normal, vec3& irradiance) const;

  // For reports: of the voxels that photons are shot in, or null.
  const asvo::Tree* presentVoxels() const { return present_.tree.get(); }
  const GRayTracer* presentDevice() const { return present_.device.get(); }
  const LightPass* pass() const { return present_.pass.get(); }

 private:
  /// Voxels with their light.
  struct Side {
    std::shared_ptr<const asvo::Tree> tree;
    std::unique_ptr<GRayTracer> device;
    std::unique_ptr<LightCache> cache;
    std::unique_ptr<LightPass> pass;
  };
  const Side& shown() const { return before_.tree ? before_ : present_; }
  void start(const Model& model, const WalkTracer& walks, const LightSet& lights,
             const CameraRays& aim, std::uint32_t width, std::uint32_t height);

  std::uint32_t seed_;
  PhotonKind kind_;
  std::uint64_t leastPhotons_;
  double slice_;  ///< seconds: LightPass
  bool lots_;     ///< LightPass::tellLots()
  std::uint32_t number_ = 0;
  std::optional<Camera> aim_;  ///< where photons from outside are aimed; none: the view
  State state_ = State::kAbsent;
  Side present_, before_;  ///< before_: of other voxels, while present_ has no light yet
  std::function<void()> setValues_;
  std::function<bool()> giveUp_;
  PhotonSharer* sharer_ = nullptr;  ///< not ours
};

}  // namespace trex
