#include "src/session/voxel_light.h"

#include <algorithm>

#include "src/session/voxel_source.h"

namespace trex {

std::unique_ptr<GRayTracer> makeLightDevice(const std::vector<Material>& materials,
                                            const std::vector<Image>& images,
                                            const asvo::Tree& tree,
                                            const RenderSettings& settings) {
  const auto photons = photonMaterials(materials, images);
  const VulkanLimits limits{.maxBytes = settings.maxGpuMemory};
  // A device that was asked for by its number is not left silently.
  std::unique_ptr<GRayTracer> device =
      settings.device == RenderSettings::kNoDevice ? makeCpuTracer(tree, photons)
      : settings.device == RenderSettings::kBestDevice
          ? makeAutoTracer(tree, photons, limits)
          : makeVulkanTracer(tree, photons, settings.device, limits);
  device->prepare();
  return device;
}

VoxelLight::VoxelLight(const RenderSettings& settings)
    : seed_(settings.seed),
      kind_(settings.photonKind),
      leastPhotons_(settings.photons),
      slice_(settings.interactive ? LightPass::kShortSlice : LightPass::kSlice),
      lots_(settings.dial && !settings.interactive),
      aim_(settings.aim) {}

void VoxelLight::setVoxels(std::shared_ptr<const asvo::Tree> tree,
                           std::unique_ptr<GRayTracer> device, State next) {
  if (present_.cache && present_.cache->hasLight()) before_ = std::move(present_);
  present_ = {};
  present_.tree = std::move(tree);
  present_.device = std::move(device);
  present_.cache = std::make_unique<LightCache>(*present_.tree);
  state_ = next;
}

void VoxelLight::invalidate(State from) {
  if (state_ > State::kAwaited) state_ = std::min(state_, from);
}

void VoxelLight::renew(const Model& model, const WalkTracer& walks, const LightSet& lights,
                       const Camera& view, std::uint32_t width, std::uint32_t height) {
  switch (state_) {
    case State::kValues:
      if (setValues_) setValues_();
      state_ = State::kDevice;
      return;
    case State::kDevice:
      present_.device->refresh(photonMaterials(model.scene.materials, model.scene.images));
      state_ = State::kPhotons;
      return;
    case State::kPhotons:
      start(model, walks, lights,
            CameraRays(aim_.value_or(view), model.rays->renderOrigin(), width, height), width,
            height);
      state_ = State::kShooting;
      return;
    case State::kAbsent:
    case State::kAwaited:
    case State::kShooting:
    case State::kReady:
      return;
  }
}

/// Photons of the present lights start anew.
void VoxelLight::start(const Model& model, const WalkTracer& walks, const LightSet& lights,
                       const CameraRays& aim, std::uint32_t width, std::uint32_t height) {
  Side& side = present_;
  ++number_;
  side.device->resetFlux();
  const bool rays =
      kind_ == PhotonKind::kRay || (kind_ == PhotonKind::kAuto && side.device->sharesHostCores());
  side.pass = std::make_unique<LightPass>(model.scene, walks, lights, *side.device, *side.cache,
                                          seed_, rays, slice_);
  if (lots_) side.pass->tellLots();
  side.pass->share(sharer_);
  side.pass->aim(aim, width, height);
}

bool VoxelLight::shoot(std::uint64_t photons, const std::function<bool()>& keepGoing,
                       std::uint64_t before) {
  if (!present_.pass->run(before, keepGoing, giveUp_)) return false;
  if (!present_.pass->run(photons, keepGoing, giveUp_)) return false;
  before_ = {};
  state_ = State::kReady;
  return true;
}

void VoxelLight::aimAt(const Camera& view) {
  aim_ = view;
  leastPhotons_ = 0;
}

bool VoxelLight::at(const vec3& position, const vec3& normal, vec3& irradiance) const {
  return hasLight() && cache()->irradiance(position, normal, 0.0f, vec2(0.5f), irradiance);
}

}  // namespace trex
