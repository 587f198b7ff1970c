// The viewer's side of the session: steps that fit a frame of the screen, and what an edit makes
// invalid.
//
//   state          samples go to    read
//   previewing     preview          the light of before, scaled to the lights' power; exact paths
//                                   where there is none
//   light ready    the frame        its own light
#include <algorithm>
#include <chrono>

#include "src/frame/lattice.h"
#include "src/session/batch.h"
#include "src/session/light_side.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

constexpr double kBatchSeconds = 0.003;        // between two questions whether to go on
constexpr std::uint32_t kPreviewSamples = 64;  // no preview lives that long
constexpr std::uint32_t kLeastBatch = 256, kLargestBatch = 1u << 16;

/// First sample after `sample` for which more photons are shot.
std::uint32_t nextLightSample(std::uint32_t sample, std::uint64_t pixels) {
  std::uint32_t next = 4;
  while (next <= sample && next < (1u << 30)) next *= 4;
  // Targets stand still once all photons there can be are shot.
  return photonTarget(next, pixels) > photonTarget(sample, pixels) ? next : 0xffffffffu;
}

}  // namespace

std::unique_ptr<GRayTracer> Session::makeDevice(const std::vector<Material>& materials,
                                                const std::vector<Image>& images,
                                                const asvo::Tree& tree,
                                                const RenderSettings& settings) {
  const auto photons = photonMaterials(materials, images);
  if (settings.device == RenderSettings::kNoDevice) return makeCpuTracer(tree, photons);
  const VulkanLimits limits{.maxBytes = settings.maxGpuMemory};
  if (settings.device == RenderSettings::kBestDevice) return makeAutoTracer(tree, photons, limits);
  // A device that was asked for by its number is not left silently.
  return makeVulkanTracer(tree, photons, settings.device, limits);
}

void Session::setVoxels(std::shared_ptr<const asvo::Tree> tree,
                        std::unique_ptr<GRayTracer> device) {
  report_.voxels = tree->info.nodeCount;
  report_.leaves = tree->info.leafCount;
  report_.voxelDepth = static_cast<int>(tree->info.depth);
  report_.voxelBytes = tree->nodes.size() * sizeof(asvo::uvec2) +
                       tree->voxels.size() * sizeof(asvo::uvec4) +
                       tree->leaves.size() * sizeof(asvo::uvec2);
  report_.device = device->name();
  auto side = std::make_unique<LightSide>();
  side->tree = std::move(tree);
  side->device = std::move(device);
  side->cache = std::make_unique<LightCache>(*side->tree);
  voxelsComing_ = false;
  (light_ ? coming_ : light_) = std::move(side);
  if (settings_.interactive) {
    stale_ = Stale::kValues;
    makeIntegrators();
  } else {
    startLight();
  }
}

Session::LightSide* Session::nextLight() const { return coming_ ? coming_.get() : light_.get(); }

bool Session::wantsGuess() const {
  return settings_.exact < 1.0 && lights_->anyPower() && (light_ || voxelsComing_);
}

/// After an edit: voxels get their values, the device reads them, photons start; one of it at a
/// time.
void Session::renewLight() {
  switch (stale_) {
    case Stale::kValues:
      if (beforeLight_) beforeLight_();
      stale_ = Stale::kDevice;
      return;
    case Stale::kDevice:
      nextLight()->device->refresh(photonMaterials(model_->scene.materials, model_->scene.images));
      stale_ = Stale::kPhotons;
      return;
    case Stale::kPhotons:
      startLight();
      stale_ = Stale::kNothing;
      return;
    case Stale::kNothing:
      return;
  }
}

void Session::resize(std::uint32_t width, std::uint32_t height) {
  settings_.width = width;
  settings_.height = height;
  makeFrames();
  if (const LightSide* side = nextLight(); side != nullptr && side->pass) {
    settings_.photons = side->pass->resolved();
  }
  camera_ = std::make_unique<CameraRays>(view_, model_->rays->renderOrigin(), width, height);
  makeCaustics();
  makeIntegrators();
}

/// Photons of the present lights start anew.
void Session::startLight() {
  LightSide* side = nextLight();
  if (side == nullptr) return;
  side->device->resetFlux();
  const bool rays = settings_.photonKind == PhotonKind::kRay ||
                    (settings_.photonKind == PhotonKind::kAuto && side->device->sharesHostCores());
  side->pass = std::make_unique<LightPass>(model_->scene, *model_->rays, *lights_, *side->device,
                                           *side->cache, settings_.seed, rays);
  report_.photonRays = side->pass->rayBounces();
  if (settings_.interactive) settings_.aim = view_;
  const double mark = secondsNow();
  const CameraRays aim(settings_.aim.value_or(view_), model_->rays->renderOrigin(), settings_.width,
                       settings_.height);
  side->pass->aim(aim, settings_.width, settings_.height);
  if (settings_.interactive) {
    settings_.photons = 0;
  } else {
    report_.aimSeconds = report_.renderSeconds = secondsNow() - mark;
  }
}

void Session::makeIntegrators() {
  const auto make = [&](const LightSide* side, const CausticMaps* caustics) {
    GuessOptions guess;
    if (settings_.exact < 1.0 && side != nullptr && lights_->anyPower()) {
      guess.cache = side->cache.get();
      guess.cones = settings_.guess == GuessKind::kCone ||
                    (settings_.guess == GuessKind::kAuto && !side->device->sharesHostCores());
    }
    report_.cones = guess.cones;
    return std::make_unique<Integrator>(model_->scene, *model_->rays, *lights_, *camera_, guess,
                                        settings_.seed, !settings_.transparent, caustics);
  };
  integrator_ = make(light_.get(), caustics_.get());
  if (!settings_.interactive) return;
  // Light of another time serves previews, if there is any.
  const bool old = light_ && light_->cache->hasLight();
  previewIntegrator_ = make(old ? light_.get() : nullptr, nullptr);
}

/// Maps are made when samples ask for them.
void Session::makeCaustics() {
  caustics_.reset();
  if (!CausticMaps::needed(model_->scene)) return;
  const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
  caustics_ = std::make_unique<CausticMaps>(model_->scene, *model_->rays, pixels, settings_.seed);
}

void Session::voxelsAreComing() {
  voxelsComing_ = true;
  makeIntegrators();
}

void Session::follow(const Invalidation& what, const Camera& camera) {
  view_ = camera;
  const RayScene& rays = *model_->rays;
  camera_ =
      std::make_unique<CameraRays>(camera, rays.renderOrigin(), settings_.width, settings_.height);
  const double power = lights_->totalPower();
  if (what.lights) {
    lights_ = std::make_unique<LightSet>(model_->scene, rays);
    if (light_ && power > 0.0) light_->cache->scaleLight(lights_->totalPower() / power);
  }
  if (what.flux || what.lights) makeCaustics();
  if (what.flux && nextLight() != nullptr) {
    stale_ = std::max(stale_, what.voxelValues ? Stale::kValues : Stale::kPhotons);
  }
  if (const LightSide* side = nextLight(); stale_ == Stale::kNothing && side != nullptr) {
    settings_.photons = side->pass->resolved();  // a camera move keeps them
  }
  if (what.frame) {
    frame_->restart();
    preview_->restart();
    error_ = kInfinity;
    errorCheck_ = 16;
  }
  makeIntegrators();
}

bool Session::aimAgain() {
  LightSide* side = nextLight();
  // In the dark no photons have been asked for yet.
  if (side == nullptr || side->pass == nullptr || previewing()) return false;
  if (!side->pass->guided() || settings_.aim == view_) return false;
  startLight();
  frame_->restart();
  preview_->restart();
  makeIntegrators();
  return true;
}

bool Session::previewing() const {
  if (!wantsGuess()) return false;
  return voxelsComing_ || stale_ != Stale::kNothing || coming_ || light_->pass->resolved() == 0;
}

const FrameBuffers& Session::shownFrame() const { return previewing() ? *preview_ : *frame_; }

const asvo::Tree* Session::voxels() const { return light_ ? light_->tree.get() : nullptr; }

Session::Step Session::step(const std::function<bool()>& keepGoing, vec2 pointer) {
  const double mark = secondsNow();
  const Step step = nextStep(keepGoing, pointer);
  resting_ = step == Step::kIdle;
  report_.renderSeconds += secondsNow() - mark;
  return step;
}

Session::Step Session::nextStep(const std::function<bool()>& keepGoing, vec2 pointer) {
  if (previewing()) {
    preview_->tiles.setBarrier(kPreviewSamples);
    const bool coarse = preview_->tiles.coarseCells() < 16;
    // Later every third step is the preview's, so that it goes on while photons are shot.
    previewTurn_ = (previewTurn_ + 1) % 3;
    if (coarse || voxelsComing_ || (previewTurn_ == 0 && !preview_->tiles.atBarrier())) {
      return takeSamples(*preview_, *previewIntegrator_, keepGoing, pointer) ? Step::kPreview
                                                                             : Step::kIdle;
    }
    if (stale_ != Stale::kNothing) {
      renewLight();
      return Step::kLight;
    }
    if (!bringLight(keepGoing)) return Step::kLight;
    if (coming_) light_ = std::move(coming_);
    frame_->restart();
    makeIntegrators();
    return Step::kLight;
  }
  const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
  if (wantsGuess()) {
    if (lightDue()) {
      bringLight(keepGoing);
      return Step::kLight;
    }
  }
  const std::uint32_t all = settings_.samples > 0 ? settings_.samples : 0xffffffffu;
  frame_->tiles.setBarrier(wantsGuess() ? std::min(all, nextLightSample(samplesDone(), pixels))
                                        : all);
  if (goalReached()) return Step::kIdle;
  if (!takeSamples(*frame_, *integrator_, keepGoing, pointer)) return Step::kIdle;
  checkError();
  return Step::kSamples;
}

/// Samples in perceptual order until the time is up. False if every tile has what it may have.
bool Session::takeSamples(FrameBuffers& frame, const Integrator& integrator,
                          const std::function<bool()>& keepGoing, vec2 pointer) {
  frame.tiles.beginFrame(pointer, batchPixels_ / 4);
  Batch batches[2];
  bool more = true, any = false;
  for (std::size_t i = 0; more; ++i) {
    // The coarsest picture is finished in any case.
    if (any && frame.tiles.coarseCells() > 0 && !keepGoing()) break;
    Batch& batch = batches[i % 2];
    const double mark = secondsNow();
    while (more && batch.jobs.size() < batchPixels_) {
      const auto unit = frame.tiles.next();
      more = unit.has_value();
      if (unit) addJobs(frame, *unit, batch);
    }
    const std::size_t jobs = batch.jobs.size();
    any |= jobs > 0;
    if (jobs > 0) trace(integrator, batch);
    merge(frame, batches[(i + 1) % 2]);
    const double taken = secondsNow() - mark;
    if (taken > 1.5 * kBatchSeconds) batchPixels_ = std::max(batchPixels_ / 2, kLeastBatch);
    if (taken < 0.5 * kBatchSeconds && jobs >= batchPixels_) {
      batchPixels_ = std::min(batchPixels_ * 2, kLargestBatch);
    }
  }
  for (Batch& batch : batches) merge(frame, batch);
  return any;
}

bool Session::cachedLight(const vec3& position, const vec3& normal, vec3& irradiance) const {
  return light_ && light_->cache->irradiance(position, normal, 0.0f, vec2(0.5f), irradiance);
}

PathSample Session::probe(std::uint32_t x, std::uint32_t y, std::uint32_t sample) const {
  std::vector<ConeRequest> cones;
  RayCounts counts;
  return integrator_->sample(x, y, settings_.width, sample, true, 0, cones, counts);
}

}  // namespace trex
