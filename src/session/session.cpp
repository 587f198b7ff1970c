#include "src/session/session.h"

#include <algorithm>
#include <utility>

#include "src/core/clock.h"
#include "src/core/threads.h"
#include "src/crays/reading_pages.h"
#include "src/paths/walk_tracer.h"
#include "src/session/cone_share.h"
#include "src/session/missed_pages.h"
#include "src/session/picture_error.h"
#include "src/session/unfiltered_pixels.h"

namespace trex {
namespace {

constexpr std::uint32_t kTileSize = 64;
constexpr std::uint32_t kSharedAtOnce = 1u << 16;  // samples: machines wait for each other at looks
constexpr double kPageSeconds = 0.002;  // to wait for pages, before it is asked whether to go on
/// Photons that so often missed pages wait for them.
constexpr std::uint32_t kMostLightTries = 24;

}  // namespace

Session::Session(std::shared_ptr<const Model> model, const Camera& camera,
                 const RenderSettings& settings, const PictureLayers& layers)
    : settings_(settings),
      layers_(layers),
      model_(std::move(model)),
      view_(camera),
      method_(denoiseMethod(settings_)),
      goal_(settings_),
      light_(settings_),
      samples_(model_->scene, settings_) {
  if (!settings_.interactive) prepareDenoiser(settings_);
  layers_.alpha |= settings_.transparent;
  makeFrames();
  keepTimeFree();
  lights_ = std::make_unique<LightSet>(model_->scene, *model_->rays);
  report_.mesh = model_->rays->statistics();
  report_.meshSeconds = model_->meshSeconds;
  report_.voxelSeconds = model_->voxelSeconds;
  makeCamera();
  if (settings_.exact < 1.0 && model_->voxels && lights_->anyPower()) {
    const double mark = secondsNow();
    light_.setVoxels(
        model_->voxels,
        makeLightDevice(model_->scene.materials, model_->scene.images, *model_->voxels, settings_),
        VoxelLight::State::kPhotons);
    report_.deviceSeconds = secondsNow() - mark;
  }
  makeWalks();
  makeCaustics();
  makeSources();
}

Session::~Session() = default;

// ---- the loop ----

void Session::run(const KeepGoing& keepGoing) {
  bool going = true;
  const auto ask = [&] {
    going = going && keepGoing();
    return going;
  };
  while (going && step(ask, vec2(0.5f))) continue;
}

std::optional<Work> Session::step(const KeepGoing& keepGoing, vec2 pointer) {
  const std::optional<Work> work = plan(state());
  if (work) perform(*work, keepGoing, pointer);
  return work;
}

SessionState Session::state() const {
  SessionState s;
  s.guesses = settings_.exact < 1.0 && lights_->anyPower();
  s.light = light_.state();
  s.photons = light_.photons();
  s.leastPhotons = light_.leastPhotons();
  s.inPages = inPages();
  s.pixels = pixels();
  s.samples = samplesDone();
  s.mostSamples = goal_.mostSamples();
  s.goalReached = goalReached();
  s.turn = turn_;
  // Maps of caustics are one sample's.
  if (loads_ && settings_.error == 0.0 && !caustics_) s.samplesAtOnce = samplesAtOnce();
  if (sharer_) s.samplesAtOnce = kSharedAtOnce;
  s.nextLook = nextLook();
  s.interactive = preview_ != nullptr;
  if (!preview_) return s;
  s.lightOfBefore = light_.hasLight();
  s.exactPreviews = !light_.shared();
  s.previewCells = preview_->tiles.coarseCells();
  s.previewSamples = preview_->tiles.samplesDone();
  return s;
}

void Session::perform(const Work& work, const KeepGoing& keepGoing, vec2 pointer) {
  const double start = secondsNow() - report_.renderSeconds;
  const auto time = [&] {
    report_.renderSeconds = secondsNow() - start;
    const bool first = report_.firstPictureSeconds == 0.0 && samplesDone() > 0;
    if (first) report_.firstPictureSeconds = report_.renderSeconds;
  };
  const auto going = [&] {
    time();
    return keepGoing() && !goal_.late(samplesDone(), report_.renderSeconds);
  };
  const RaysWait never(behind(), false);
  source_.waitsAtLast = helper_ == nullptr || !helper_->takesAll();
  previewSource_.waitsAtLast = source_.waitsAtLast;
  switch (work.kind) {
    case Work::Kind::kSamples:
      frame_->tiles.setBarrier(work.barrier);
      takeSamples(going, pointer);
      if (frame_->dial) frame_->dial->look(frame_->tiles.tiles(), samplesDone(), frame_->sums);
      keepTimeFree();
      lookAtGoal();
      break;
    case Work::Kind::kPhotons:
      shootAsPagesCome(work.photons, going);
      break;
    case Work::Kind::kLight:
      renewLight();
      break;
    case Work::Kind::kPreview:
      preview_->tiles.setBarrier(work.barrier);
      do {
        samples_.take(*preview_, previewSource_, light_, going, pointer);
      } while (preview_->tiles.pagesAwaited() > 0 && going() &&
               awaitPages(preview_->tiles.pagesAwaited()));
      break;
  }
  ++turn_;
  time();
}

/// Samples of the frame, by whoever takes them.
void Session::takeSamples(const KeepGoing& keepGoing, vec2 pointer) {
  if (sharer_) return sharer_->take(*this, keepGoing);
  if (helper_) helper_->exchange(*this, keepGoing);
  const auto lacks = [&] { return frame_->tiles.pagesAwaited(); };
  do {
    samples_.take(*frame_, source_, light_, keepGoing, pointer);
  } while ((helper_ || lacks() > 0) && keepGoing() &&
           ((helper_ && helper_->await(*this, keepGoing)) || awaitPages(lacks())));
}

/// A mesh whose pages come behind rays that do not wait, or null.
const hccm::PagedMesh* Session::behind() const {
  const hccm::PagedMesh* paged = model_->rays->parts().paged.get();
  return settings_.interactive && paged != nullptr && paged->fetcher() != nullptr ? paged : nullptr;
}

/// Waits a little until so many pages have come. False for none.
bool Session::awaitPages(std::uint64_t count) const {
  if (count == 0) return false;
  readingPages([&] { behind()->fetcher()->await(count, kPageSeconds); });
  return true;
}

/// Photons of which one missed a page come to nothing, and are shot again once it is there.
void Session::shootAsPagesCome(std::uint64_t photons, const KeepGoing& keepGoing) {
  const hccm::PagedMesh* mesh = behind();
  do {
    const std::uint64_t missed = model_->rays->missed(), before = light_.pass()->emitted();
    if (mesh != nullptr) mesh->setWaiting(lightTries_ >= kMostLightTries);
    shootPhotons(photons, keepGoing);
    if (light_.pass()->emitted() != before) lightTries_ = 0;
    lightTries_ = model_->rays->missed() == missed ? 0 : lightTries_ + 1;
  } while (lightTries_ > 0 && keepGoing() && awaitPages(mesh->fetcher()->asked()));
}

/// Samples at which the dial or the goal looks at the sums.
std::uint32_t Session::nextLook() const {
  std::uint32_t next = frame_->dial ? frame_->dial->nextLook() : kAnySamples;
  if (settings_.error > 0.0) next = std::min(next, std::max(goal_.nextLook(), samplesDone() + 1));
  return next;
}

/// Of the seconds of the goal, for the denoiser.
void Session::keepTimeFree() {
  if (settings_.seconds > 0.0) goal_.keepFree(denoiseSeconds(method_, settings_, corrected()));
}

/// Whether the picture of now is corrected by pairs. A dial has enough of them after a while.
bool Session::corrected() const {
  if (!shownOptions().pairs) return false;
  return !frame_->dial || frame_->dial->meanPairs() >= kPairsThatTell;
}

/// Estimates the error if it is a goal and an estimate is due.
void Session::lookAtGoal() {
  if (!frame_->dial) return goal_.look(frame_->sums, samplesDone());
  if (!goal_.wantsLook(samplesDone())) return;
  const double error = estimatedError();
  goal_.look(samplesDone(), error < 0.0 ? kInfinity : error);
}

/// Samples of the frame wait for the first light, and begin with it.
void Session::shootPhotons(std::uint64_t photons, const KeepGoing& keepGoing) {
  const bool first = light_.state() == VoxelLight::State::kShooting;
  if (sharer_) sharer_->lightComes(*this, photons);
  if (helper_) helper_->lightComes(*this, photons);
  const LightCache* before = light_.cache();
  if (!light_.shoot(photons, keepGoing, photonsBefore(photons)) || !first) return;
  frame_->restart(preview_ && preview_->looks ? preview_.get() : nullptr);
  ++frameNumber_;
  if (light_.cache() != before) makeSources();
}

/// Of so many photons, how many tell the noise of all if that is asked for.
std::uint64_t Session::photonsBefore(std::uint64_t photons) const {
  const PhotonNoise* noise = frame_->photonNoise.get();
  return noise != nullptr ? trex::photonsBefore(noise->lights(), photons) : 0;
}

/// One step towards photons. Those of the viewer go where it looks.
void Session::renewLight() {
  const bool photons = light_.state() == VoxelLight::State::kPhotons;
  if (photons && settings_.interactive) light_.aimAt(view_);
  const double mark = secondsNow();
  const std::uint64_t missed = model_->rays->missed();
  if (behind() != nullptr) behind()->setWaiting(lightTries_ >= kMostLightTries);
  light_.renew(*model_, *walks_, *lights_, view_, settings_.width, settings_.height);
  if (photons) report_.aimSeconds = secondsNow() - mark;
  if (model_->rays->missed() == missed) return;
  ++lightTries_;
  light_.invalidate(VoxelLight::State::kPhotons);  // they are aimed anew
  awaitPages(behind()->fetcher()->asked());
}

double Session::progress() const {
  const double part = static_cast<double>(frame_->tiles.tilesDone()) /
                      static_cast<double>(frame_->tiles.tiles().size());
  return goal_.progress(samplesDone() + part, report_.renderSeconds);
}

double Session::estimatedError(std::uint32_t stride) const {
  if (samplesDone() < 2) return -1.0;
  if (!frame_->photonNoise || stride != 1) return frame_->sums.estimatedError(stride);
  const double error = method_ == DenoiseMethod::kOff ? UnfilteredPixels(*frame_).estimatedError()
                                                      : estimatePictureError(*frame_);
  return error < kInfinity ? error : -1.0;
}

std::optional<PathSample> Session::probe(std::uint32_t x, std::uint32_t y,
                                         std::uint32_t sample) const {
  const RaysWait never(behind(), false);
  const std::uint64_t missed = model_->rays->missed();
  const PathSample taken = source_.tracer->sample({x, y, sample, true}, settings_.width);
  if (model_->rays->missed() != missed) return {};
  return taken;
}

/// Samples of a pixel that are under way at once where paths wait for pages.
std::uint32_t Session::samplesAtOnce() const {
  const std::uint64_t whole = pathsThatWait(model_->scene, settings_.rayMemory) / pixels();
  return static_cast<std::uint32_t>(std::clamp<std::uint64_t>(whole, 1, 1u << 16));
}

// ---- what samples need ----

void Session::makeFrames() {
  using Order = TileScheduler::Order;
  const std::uint32_t width = settings_.width, height = settings_.height;
  PictureLayers kept = layers_;
  kept.direct |= mayUseOidn(settings_);
  const bool filtered = method_ != DenoiseMethod::kOff;
  // A model without voxels has no guesses; the viewer's may get some.
  const bool guesses = settings_.interactive || model_->voxels != nullptr;
  const bool pairs = shownOptions().pairs && guesses;
  const auto make = [&](Order order) {
    return std::make_unique<FrameBuffers>(
        width, height, pairs, filtered, kept,
        TileScheduler(makeTiles(width, height, kTileSize), order, width, height));
  };
  frame_ = make(settings_.interactive ? Order::kPerception : Order::kSweep);
  ++frameNumber_;
  if (settings_.dial) {
    frame_->dial =
        std::make_unique<Dial>(frame_->tiles.tiles().size(), pixels(),
                               DialUse{filtered ? Pooling{} : Pooling::none(), inPages()});
  }
  if (settings_.dial && !settings_.interactive && guesses) {
    frame_->photonNoise = std::make_unique<PhotonNoise>(
        width, height, lightsOf(pixels(), settings_.photons, inPages()));
    if (filtered) frame_->lightNoise = std::make_unique<LightNoise>(width, height);
  }
  if (!settings_.interactive) return;
  preview_ = make(Order::kPerception);
  // Media light what lies behind them, so that no look can tell what a pixel shows.
  const bool looks = filtered && model_->rays->media() == nullptr;
  if (!looks) return;
  frame_->looks = std::make_shared<LookImage>(width, height);
  frame_->memory = std::make_shared<LightMemory>();
  frame_->tiles.setLooks(kLooks);
}

void Session::makeCamera() {
  camera_ = std::make_unique<CameraRays>(view_, model_->rays->renderOrigin(), settings_.width,
                                         settings_.height);
}

/// What traces all paths but those of the camera; where pages do not fit in memory they wait, too.
void Session::makeWalks() {
  const RayScene& rays = *model_->rays;
  if (settings_.rayMemory == 0 || !rays.parts().paged || settings_.interactive) {
    walks_ = std::make_unique<const WalkTracer>(rays);
    return;
  }
  loads_ = std::make_unique<LoadChoice>(rays.parts().paged->table(), settings_.loadOrder);
  if (settings_.recordTraffic) {
    const bool cones = settings_.exact < 1.0 && model_->voxels && lights_->anyPower();
    traffic_ = std::make_unique<TrafficRecord>(static_cast<unsigned>(threadsAllowed()),
                                               PageRounds::kReaders, cones);
    if (cones) gathers_ = std::make_unique<GatherPlan>(*traffic_);
  }
  walks_ = std::make_unique<const WalkTracer>(rays, *loads_, settings_.rayMemory, traffic_.get());
}

/// Maps are made when samples ask for them.
void Session::makeCaustics() {
  caustics_.reset();
  if (!CausticMaps::needed(model_->scene)) return;
  caustics_ = std::make_unique<CausticMaps>(model_->scene, *walks_, pixels(), settings_.seed);
}

void Session::makeSources() {
  source_ = source(light_.cache(), caustics_.get());
  source_.pairs = source_.tracer->guesses();
  report_.coneShare = source_.tracer->coneShare();
  source_.gathers = gathers_.get();
  if (!preview_) return;
  // Light of another time serves previews, if there is any; maps of caustics, where the view is the
  // frame's, so that their samples tell the same.
  previewSource_ = source(light_.hasLight() ? light_.cache() : nullptr,
                          preview_->looks ? caustics_.get() : nullptr);
}

/// What samples read: cached light, or paths alone where there is none.
SampleSource Session::source(const LightCache* cache, CausticMaps* caustics) {
  GuessOptions guess;
  if (settings_.exact < 1.0 && cache != nullptr && lights_->anyPower()) {
    guess.cache = cache;
    guess.coneShare = wantedConeShare();
    guess.noise = frame_->photonNoise != nullptr;
  }
  SampleSource made;
  made.behind = behind();
  made.tracer =
      std::make_unique<PathTracer>(model_->scene, *model_->rays, *lights_, *camera_, guess,
                                   settings_.seed, !settings_.transparent, caustics);
  made.caustics = caustics;
  if (loads_)
    made.batched =
        std::make_unique<BatchedTracer>(*made.tracer, *model_->rays, *loads_, traffic_.get());
  return made;
}

double Session::wantedConeShare() {
  if (coneShare_) return *coneShare_;
  switch (settings_.guess) {
    case GuessKind::kRay:
      return 0.0;
    case GuessKind::kCone:
      return 1.0;
    case GuessKind::kMixed:
      return settings_.coneShare;
    case GuessKind::kAuto:
      break;
  }
  const GRayTracer& device = *light_.device();
  return autoConeShare(settings_.machine.get(), device.name(), device.sharesHostCores());
}

void Session::setConeShare(double share) {
  coneShare_ = share;
  if (source_.pairs && share != coneShare()) makeSources();
}

}  // namespace trex
