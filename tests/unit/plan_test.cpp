// What a session does next, asked with invented states; and the goal and the light it is asked of.
#include "src/session/plan.h"

#include <gtest/gtest.h>

#include "src/paths/walk_tracer.h"
#include "src/session/denoiser.h"
#include "src/session/goal.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

using Kind = Work::Kind;
using State = VoxelLight::State;

constexpr std::uint64_t kPixels = 640 * 360;

SessionState capture(State light) {
  SessionState s;
  s.guesses = light != State::kAbsent;
  s.light = light;
  s.pixels = kPixels;
  return s;
}

/// With its coarse preview shown, at a turn that is not the preview's.
SessionState viewer(State light) {
  SessionState s = capture(light);
  s.guesses = s.interactive = s.lightOfBefore = true;
  s.previewCells = 16;
  s.turn = 1;
  return s;
}

Kind kindOf(const SessionState& s) { return plan(s).value().kind; }

TEST(Plan, ExactSamplesNeedNoLight) {
  EXPECT_EQ(plan(capture(State::kAbsent)), (Work{.kind = Kind::kSamples, .barrier = 1}));
  SessionState dark = viewer(State::kValues);  // nothing shines
  dark.guesses = false;
  EXPECT_EQ(kindOf(dark), Kind::kSamples);
}

TEST(Plan, CapturesMakeTheLightFirst) {
  EXPECT_EQ(kindOf(capture(State::kPhotons)), Kind::kLight);
  EXPECT_EQ(plan(capture(State::kShooting)),
            (Work{.kind = Kind::kPhotons, .photons = photonTarget(0, kPixels)}));
  SessionState s = capture(State::kReady);
  s.photons = photonTarget(0, kPixels);
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 1}));
  s.leastPhotons = s.photons + 1;
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kPhotons, .photons = s.leastPhotons}));
}

/// Samples of a model in pages are parted by photons no earlier than at the sixteenth.
TEST(Plan, SamplesThatWaitForPagesTogetherHaveOneLight) {
  SessionState s = capture(State::kShooting);
  s.inPages = true;
  s.samplesAtOnce = 64;
  s.mostSamples = 40;
  EXPECT_EQ(plan(s)->photons, photonTarget(4, kPixels));
  s.light = State::kReady;
  s.photons = photonTarget(4, kPixels);
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 16}));
  s.samples = 16;
  EXPECT_EQ(plan(s)->photons, photonTarget(16, kPixels));
  s.photons = photonTarget(16, kPixels);
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 40}));
  s.leastPhotons = s.photons = photonTarget(64, kPixels);  // none are shot in between
  s.samples = 3;
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 40}));
}

/// The longer a render, the better the denoiser, and never more than a quarter of the time for it.
TEST(Denoiser, WaysFollowFromTheTime) {
  using Method = DenoiseMethod;
  constexpr double kQuick = 0.05;
  EXPECT_EQ(wayWithin(0.19, kQuick), Method::kFilter);
  EXPECT_EQ(wayWithin(0.21, kQuick), Method::kOidnQuick);
  EXPECT_EQ(wayWithin(0.5, kQuick), Method::kOidnWell);
  EXPECT_EQ(wayWithin(2.0, kQuick), Method::kOidnThorough);
  Method before = Method::kFilter;
  for (double seconds = 0.01; seconds < 10.0; seconds *= 1.1) {
    const Method now = wayWithin(seconds, kQuick);
    EXPECT_GE(now, before) << seconds;
    EXPECT_EQ(now, wayWithin(10.0 * seconds, 10.0 * kQuick)) << seconds;
    before = now;
  }
  for (const Method m : {Method::kOidnQuick, Method::kOidnWell, Method::kOidnThorough})
    EXPECT_TRUE(isOidn(m));
  EXPECT_FALSE(isOidn(Method::kFilter));
}

TEST(Plan, NothingIsDoneBeyondTheGoal) {
  SessionState s = capture(State::kReady);
  s.samples = 4;  // for which more photons would be shot
  s.goalReached = true;
  EXPECT_FALSE(plan(s).has_value());
  s.interactive = true;
  EXPECT_FALSE(plan(s).has_value());
}

TEST(Plan, TheViewersTilesWaitWhereTheLightChanges) {
  SessionState s = viewer(State::kReady);
  s.samples = 5;
  s.photons = photonTarget(5, kPixels);
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 16}));
  s.mostSamples = 9;
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 9}));
  s.guesses = false;
  s.mostSamples = 100;
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 100}));
}

TEST(Plan, TilesWaitWhereTheDialLooks) {
  SessionState s = viewer(State::kReady);
  s.samples = 5;
  s.photons = photonTarget(5, kPixels);
  s.nextLook = 6;
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kSamples, .barrier = 6}));
}

TEST(Plan, ACoarsePreviewComesBeforeTheLight) {
  for (const State light : {State::kAwaited, State::kValues, State::kDevice, State::kPhotons}) {
    SessionState s = viewer(light);
    s.previewCells = 12;
    EXPECT_EQ(kindOf(s), Kind::kPreview);
  }
  EXPECT_EQ(kindOf(viewer(State::kValues)), Kind::kLight);
  EXPECT_EQ(kindOf(viewer(State::kDevice)), Kind::kLight);
  EXPECT_EQ(kindOf(viewer(State::kPhotons)), Kind::kLight);
  EXPECT_EQ(kindOf(viewer(State::kShooting)), Kind::kPhotons);
}

/// Else a camera that moves every few steps would never see it: each move begins a new preview.
TEST(Plan, TheFirstLightWaitsForTheCoarsestPictureAlone) {
  SessionState s = viewer(State::kValues);
  s.lightOfBefore = false;
  s.previewCells = 0;
  EXPECT_EQ(kindOf(s), Kind::kPreview);
  s.previewCells = 1;
  EXPECT_EQ(kindOf(s), Kind::kLight);
}

TEST(Plan, ThePreviewGoesOnWhilePhotonsAreShot) {
  SessionState s = viewer(State::kShooting);
  int previews = 0;
  for (s.turn = 0; s.turn < 30; ++s.turn) previews += kindOf(s) == Kind::kPreview ? 1 : 0;
  EXPECT_EQ(previews, 10);
  s.turn = 0;
  s.previewSamples = 64;  // enough
  EXPECT_EQ(kindOf(s), Kind::kPhotons);
}

TEST(Plan, WhileVoxelsAreAwaitedThereArePreviewsAlone) {
  SessionState s = viewer(State::kAwaited);
  EXPECT_EQ(plan(s), (Work{.kind = Kind::kPreview, .barrier = 64}));
  s.previewSamples = 64;
  EXPECT_FALSE(plan(s).has_value());
}

/// Does as it is told until nothing is left, and looks at what samples read.
std::uint32_t worksUntilDone(SessionState s, std::uint32_t samples) {
  s.mostSamples = samples;
  std::uint32_t works = 0;
  while (const auto work = plan(s)) {
    ++works;
    ++s.turn;
    switch (work->kind) {
      case Kind::kPreview:
        s.previewCells = std::min(s.previewCells + 16, 64u);
        break;
      case Kind::kLight:
        s.light = static_cast<State>(static_cast<int>(s.light) + 1);
        break;
      case Kind::kPhotons:
        EXPECT_GT(work->photons, s.photons);
        s.photons = work->photons;
        s.light = State::kReady;
        break;
      case Kind::kSamples:
        EXPECT_GT(work->barrier, s.samples);
        // Any sample up to the barrier may be taken now, with this light.
        for (std::uint32_t i = s.samples; i < work->barrier; ++i) {
          EXPECT_EQ(s.photons, photonTarget(i, kPixels)) << "sample " << i;
        }
        s.samples = work->barrier;
        s.goalReached = s.samples >= samples;
        break;
    }
    if (works > 10000) break;
  }
  EXPECT_EQ(s.samples, samples);
  return works;
}

TEST(Plan, EverySampleReadsTheLightOfItsNumber) {
  EXPECT_EQ(worksUntilDone(capture(State::kPhotons), 70), 1u + 4u + 70u);  // photons: 0, 4, 16, 64
  EXPECT_LT(worksUntilDone(viewer(State::kValues), 70), 20u);
}

RenderSettings settings() {
  RenderSettings s;
  s.width = s.height = 16;
  s.device = RenderSettings::kNoDevice;
  s.photonKind = PhotonKind::kRay;
  return s;
}

TEST(Goal, IsWhateverComesFirst) {
  RenderSettings s = settings();
  EXPECT_FALSE(Goal(s).reached(1u << 30, 1e9));
  s.samples = 8;
  s.seconds = 10.0;
  const Goal goal(s);
  EXPECT_FALSE(goal.reached(7, 9.9));
  EXPECT_TRUE(goal.reached(8, 0.0));
  EXPECT_TRUE(goal.reached(1, 10.0));
  EXPECT_FALSE(goal.reached(0, 10.0));  // a picture has no holes
  EXPECT_DOUBLE_EQ(goal.progress(2.0, 1.0), 0.25);
  EXPECT_DOUBLE_EQ(goal.progress(2.0, 5.0), 0.5);
  EXPECT_DOUBLE_EQ(goal.progress(2.0, 50.0), 1.0);
}

TEST(Goal, SecondsAreKeptFreeForTheDenoiser) {
  RenderSettings s = settings();
  s.seconds = 10.0;
  Goal goal(s);
  goal.keepFree(2.0);
  EXPECT_FALSE(goal.reached(5, 7.9));
  EXPECT_TRUE(goal.reached(5, 8.0));
  EXPECT_DOUBLE_EQ(goal.progress(5.0, 4.0), 0.5);
  goal.keepFree(1.0);
  EXPECT_FALSE(goal.reached(5, 8.9));
  goal.keepFree(100.0);  // a tenth is for samples all the same
  EXPECT_FALSE(goal.reached(5, 0.9));
  EXPECT_TRUE(goal.reached(5, 1.0));
}

TEST(Goal, TheErrorIsLookedAtNowAndThen) {
  RenderSettings s = settings();
  s.error = 0.1;
  Goal goal(s);
  Accumulator even(16, 16, false);
  const auto fill = [&](std::uint32_t sample) {
    for (std::uint32_t i = 0; i < 256; ++i) even.add(i % 16, i / 16, sample, vec3(1.0f), nullptr);
  };
  for (std::uint32_t sample = 0; sample < 16; ++sample) {
    goal.look(even, sample);
    EXPECT_FALSE(goal.reached(sample, 0.0));
    fill(sample);
  }
  goal.look(even, 16);
  EXPECT_TRUE(goal.reached(16, 0.0));
  EXPECT_EQ(goal.nextLook(), 18u);
  goal.restart();
  EXPECT_FALSE(goal.reached(16, 0.0));
}

/// A lit room.
std::shared_ptr<const Model> room() {
  Scene scene;
  scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 8.0f)};
  test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
  test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
  return std::make_shared<const Model>(makeModel(scene, {.voxels = true, .voxelDepth = 4}));
}

class LightTest : public testing::Test {
 protected:
  void setVoxels(State next) {
    light_.setVoxels(
        model_->voxels,
        makeLightDevice(model_->scene.materials, model_->scene.images, *model_->voxels, settings()),
        next);
  }
  void renew() { light_.renew(*model_, walks_, lights_, model_->scene.cameras.front(), 16, 16); }
  bool shoot(bool going = true) {
    return light_.shoot(5000, [&] { return going; });
  }
  bool lit() const {
    vec3 irradiance;
    return light_.at(vec3(0.0f, -2.0f, 0.0f), vec3(0.0f, 1.0f, 0.0f), irradiance) &&
           irradiance.x > 0.0f;
  }

  std::shared_ptr<const Model> model_ = room();
  WalkTracer walks_{*model_->rays};
  LightSet lights_{model_->scene, *model_->rays};
  VoxelLight light_{settings()};
};

TEST_F(LightTest, GoesFromVoxelsToPhotonsStepByStep) {
  EXPECT_EQ(light_.state(), State::kAbsent);
  light_.invalidate(State::kValues);  // nothing is there to be invalid
  EXPECT_EQ(light_.state(), State::kAbsent);
  light_.await();
  EXPECT_EQ(light_.state(), State::kAwaited);
  int values = 0;
  light_.setValues([&] { ++values; });
  setVoxels(State::kValues);
  for (const State next : {State::kDevice, State::kPhotons, State::kShooting}) {
    renew();
    EXPECT_EQ(light_.state(), next);
  }
  EXPECT_EQ(values, 1);
  EXPECT_FALSE(shoot(false));
  EXPECT_EQ(light_.state(), State::kShooting);
  EXPECT_FALSE(lit());
  EXPECT_TRUE(shoot());
  EXPECT_EQ(light_.state(), State::kReady);
  EXPECT_EQ(light_.photons(), 5000u);
  EXPECT_TRUE(lit());
}

TEST_F(LightTest, WhatIsInvalidFirstIsRenewedFirst) {
  setVoxels(State::kPhotons);
  renew();
  shoot();
  light_.invalidate(State::kPhotons);
  EXPECT_EQ(light_.state(), State::kPhotons);
  EXPECT_TRUE(lit());  // the light of before
  light_.invalidate(State::kValues);
  light_.invalidate(State::kPhotons);
  EXPECT_EQ(light_.state(), State::kValues);
  light_.await();
  light_.invalidate(State::kPhotons);
  EXPECT_EQ(light_.state(), State::kAwaited);
}

TEST_F(LightTest, OldVoxelsServeUntilTheNewOnesHavePhotons) {
  setVoxels(State::kPhotons);
  renew();
  shoot();
  const LightCache* old = light_.cache();
  for (int i = 0; i < 2; ++i) {  // replaced before they had light
    setVoxels(State::kValues);
    EXPECT_EQ(light_.cache(), old);
    EXPECT_EQ(light_.photons(), 0u);
  }
  while (light_.state() != State::kShooting) renew();
  EXPECT_EQ(light_.cache(), old);
  EXPECT_TRUE(lit());
  EXPECT_TRUE(shoot());
  EXPECT_NE(light_.cache(), old);
  EXPECT_TRUE(lit());
}

}  // namespace
}  // namespace trex
