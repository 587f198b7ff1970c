// What the viewer's edits change of a session. Photons start anew by the plan, after the first
// preview.
#include <utility>

#include "src/session/session.h"

namespace trex {

namespace {
using State = VoxelLight::State;
}  // namespace

void Session::follow(const Invalidation& what, const Camera& camera) {
  view_ = camera;
  makeCamera();
  if (what.lights) {
    const double power = lights_->totalPower();
    lights_ = std::make_unique<LightSet>(model_->scene, *model_->rays);
    // Until photons are shot the light of before stands for the new one.
    if (power > 0.0) light_.scaleBy(lights_->totalPower() / power);
  }
  if (what.flux || what.lights) {
    makeCaustics();
    if (frame_->memory) frame_->memory->clear();
  }
  if (what.flux) light_.invalidate(what.voxelValues ? State::kValues : State::kPhotons);
  if (light_.state() >= State::kShooting) light_.keepPhotons();  // a camera move keeps them
  if (what.frame) restartFrames();
  makeSources();
}

void Session::restartFrames() {
  frame_->restart();
  ++frameNumber_;
  goal_.restart();
  if (!preview_) return;
  preview_->restart();
  preview_->showAs(nullptr, 0);
}

void Session::resize(std::uint32_t width, std::uint32_t height) {
  settings_.width = width;
  settings_.height = height;
  makeFrames();
  makeCamera();
  if (light_.pass() != nullptr) light_.keepPhotons();
  makeCaustics();
  makeSources();
}

void Session::voxelsAreComing() {
  light_.await();
  makeSources();
}

void Session::setVoxels(std::shared_ptr<const asvo::Tree> tree,
                        std::unique_ptr<GRayTracer> device) {
  // While they were built their materials may have been edited.
  light_.setVoxels(std::move(tree), std::move(device), State::kValues);
  makeSources();
}

bool Session::aimAgain() {
  const bool aimed = light_.guided() && !(light_.aim() == view_);
  if (light_.state() != State::kReady || !aimed) return false;
  light_.invalidate(State::kPhotons);
  // The view is the same: what it has so far is shown, and goes on, until the new light is there.
  std::swap(frame_, preview_);
  std::swap(frame_->dial, preview_->dial);
  frame_->showAs(preview_.get(), kLooks);
  preview_->tiles.releaseAll();  // what was lent is the frame's of before
  frame_->restart(preview_.get());
  ++frameNumber_;
  goal_.restart();
  makeSources();
  return true;
}

}  // namespace trex
