#include "src/session/session.h"

#include <algorithm>
#include <chrono>

#include "src/frame/denoise.h"
#include "src/session/batch.h"
#include "src/session/light_side.h"

namespace trex {
namespace {

constexpr std::uint32_t kTileSize = 64;

/// Seconds a pixel that the filter takes here, at most: every neighbour counts on an even picture.
double filterSeconds() {
  constexpr std::uint32_t kSide = 64;
  FeatureImage features(kSide, kSide);
  const std::vector<vec3> even(kSide * kSide, vec3(1.0f));
  double best = kInfinity;
  for (int run = 0; run < 2; ++run) {
    const double mark = secondsNow();
    denoiseGuess(features, even, even);
    best = std::min(best, secondsNow() - mark);
  }
  return best / (kSide * kSide);
}

}  // namespace

Session::Session(std::shared_ptr<const Model> model, const Camera& camera,
                 const RenderSettings& settings, const PictureLayers& layers)
    : settings_(settings), layers_(layers), model_(std::move(model)), view_(camera) {
  settings_.denoise &= settings_.exact < 1.0;
  layers_.alpha |= settings_.transparent;
  makeFrames();
  const RayScene& rays = *model_->rays;
  lights_ = std::make_unique<LightSet>(model_->scene, rays);
  report_.mesh = rays.statistics();
  report_.meshSeconds = model_->meshSeconds;
  report_.voxelSeconds = model_->voxelSeconds;
  camera_ =
      std::make_unique<CameraRays>(camera, rays.renderOrigin(), settings_.width, settings_.height);
  if (settings_.exact < 1.0 && model_->voxels && lights_->anyPower()) {
    const double mark = secondsNow();
    setVoxels(model_->voxels, makeDevice(model_->scene.materials, model_->scene.images,
                                         *model_->voxels, settings_));
    report_.deviceSeconds = secondsNow() - mark - report_.aimSeconds;
  }
  if (settings_.denoise && settings_.seconds > 0.0) {
    const double filters = settings_.exact > 0.0 ? 2.0 : 1.0;
    filterEstimate_ = filters * filterSeconds() * settings_.width * settings_.height;
  }
  makeCaustics();
  makeIntegrators();
}

Session::~Session() = default;

void Session::makeFrames() {
  const std::uint32_t width = settings_.width, height = settings_.height;
  const auto make = [&](TileScheduler::Order order) {
    return std::make_unique<FrameBuffers>(
        width, height, shownOptions().pairs, settings_.denoise, layers_,
        TileScheduler(makeTiles(width, height, kTileSize), order, width, height));
  };
  frame_ = make(settings_.interactive ? TileScheduler::Order::kPerception
                                      : TileScheduler::Order::kSweep);
  if (settings_.interactive) preview_ = make(TileScheduler::Order::kPerception);
}

void Session::run(const KeepGoing& keepGoing) {
  start_ = secondsNow() - report_.renderSeconds;
  bool going = true;
  while (going && !goalReached()) {
    going = advance(keepGoing);
    report_.renderSeconds = elapsed();
  }
}

/// Whether photons must be shot before the next sample: see photonTarget().
bool Session::lightDue() const {
  const LightSide* light = nextLight();
  if (light == nullptr || !lights_->anyPower()) return false;
  const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
  return light->pass->resolved() < std::max(photonTarget(samplesDone(), pixels), settings_.photons);
}

bool Session::bringLight(const std::function<bool()>& keepGoing) {
  const std::uint64_t pixels = std::uint64_t{settings_.width} * settings_.height;
  return nextLight()->pass->run(std::max(photonTarget(samplesDone(), pixels), settings_.photons),
                                keepGoing);
}

/// What is left of one more sample of every pixel. False if it was cut short.
bool Session::advance(const KeepGoing& keepGoing) {
  const std::uint32_t sample = samplesDone();
  // The first pass is finished in any case: a picture has no holes.
  const auto going = [&] {
    const bool late = settings_.seconds > 0.0 && sample > 0 && elapsed() >= timeLimit();
    return keepGoing(progress()) && !late;
  };
  if (frame_->tiles.tilesDone() == 0 && lightDue() && !bringLight(going)) return false;
  frame_->tiles.setBarrier(sample + 1);
  Batch batches[2];
  for (std::size_t i = 0; going(); ++i) {
    const auto unit = frame_->tiles.next();
    Batch &now = batches[i % 2], &before = batches[(i + 1) % 2];
    if (unit) {
      addJobs(*frame_, *unit, now);
      trace(*integrator_, now);
    }
    merge(*frame_, before);
    if (!unit) break;
  }
  for (Batch& batch : batches) merge(*frame_, batch);
  if (samplesDone() == sample) return false;
  checkError();
  return true;
}

void Session::checkError() {
  const std::uint32_t done = samplesDone();
  if (!(settings_.error > 0.0) || done < errorCheck_) return;
  error_ = frame_->sums.estimatedError();
  errorCheck_ = done + std::max(done / 8u, 1u);
}

bool Session::goalReached() const {
  const std::uint32_t done = samplesDone();
  if (settings_.samples > 0 && done >= settings_.samples) return true;
  if (settings_.error > 0.0 && error_ <= settings_.error) return true;
  return settings_.seconds > 0.0 && done > 0 && report_.renderSeconds >= timeLimit();
}

double Session::elapsed() const { return secondsNow() - start_; }

/// The filter's share of the time is kept free.
double Session::timeLimit() const {
  return std::max(settings_.seconds - filterEstimate_, 0.1 * settings_.seconds);
}

double Session::progress() const {
  double done = 0.0;
  if (settings_.samples > 0) {
    const double part = static_cast<double>(frame_->tiles.tilesDone()) /
                        static_cast<double>(frame_->tiles.tiles().size());
    done = (samplesDone() + part) / settings_.samples;
  }
  if (settings_.seconds > 0.0) done = std::max(done, elapsed() / timeLimit());
  if (settings_.error > 0.0) done = std::max(done, settings_.error / error_);
  return std::min(done, 1.0);
}

}  // namespace trex
