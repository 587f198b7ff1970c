// Photons of one light, shot by several machines: the light, and so the picture, has the same bits
// whoever shot them, also where guides learn from them.
#include <gtest/gtest.h>

#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

/// A room that is lit through a hole in its roof: photons are guided to it.
std::shared_ptr<const Model> makeSkylight(std::uint32_t bounces) {
  Scene scene;
  scene.materials = {test::lambert(0.6f)};
  test::place(scene, test::box(vec3(-2.0f, -2.0f, -2.0f), vec3(2.0f, -1.9f, 2.0f), 0, false));
  test::place(scene, test::box(vec3(-2.0f, -1.9f, -2.0f), vec3(-1.9f, 1.9f, 2.0f), 0, false));
  test::place(scene, test::box(vec3(1.9f, -1.9f, -2.0f), vec3(2.0f, 1.9f, 2.0f), 0, false));
  test::place(scene, test::box(vec3(-2.0f, 1.9f, -2.0f), vec3(2.0f, 2.0f, 0.5f), 0, false));
  test::place(scene, test::box(vec3(-2.0f, -1.9f, -2.0f), vec3(2.0f, 1.9f, -1.9f), 0, false));
  scene.environment.color = vec3(1.0f);
  scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.8), dvec3(0.0, -0.5, -1.0), 1.0f)};
  scene.maxBounces = bounces;
  return std::make_shared<const Model>(
      makeModel(std::move(scene), {.voxels = true, .voxelDepth = 5}));
}

const std::shared_ptr<const Model>& skylight() {
  static const auto made = makeSkylight(Scene::kAnyBounces);
  return made;
}

RenderSettings manyPhotons() {
  RenderSettings s = settings(0.0, 2);
  s.photons = 40000;  // two pilot batches and a part of a third
  return s;
}

std::uint64_t photonsOfOthers(const Leader& leader) {
  std::uint64_t photons = 0;
  const auto rows = leader.rows();
  for (std::size_t i = 1; i < rows.size(); ++i) photons += rows[i].photons;
  return photons;
}

TEST(MachinePhotons, AreSharedAndTheLightIsTheSame) {
  setLogLevel(LogLevel::kQuiet);
  const std::shared_ptr<const Model> models[] = {roomModel(), skylight(), makeSkylight(6)};
  for (const auto& model : models) {
    const bool guided = model != models[0];
    const RenderSettings s = manyPhotons();
    const auto whole = sessionOf(model, s);
    whole->run();
    ASSERT_EQ(whole->light().guided(), guided);
    std::uint64_t byOthers = 0;
    for (unsigned seed = 0; seed < 6; ++seed) {
      Net net(2 + seed % 3, seed);
      Group group(net, model, s);
      if (seed % 2) group.leader().waitForModels(kGoOn);  // else they come when it is under way
      group.leader().beginView(0);
      const auto shared = sessionOf(model, s);
      shared->shareSamples(&group.leader());
      shared->run([&] {  // machine 0 is slow, so that the others have their part
        if (seed % 2) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        return true;
      });
      EXPECT_EQ(shared->picture().values, whole->picture().values) << "seed " << seed;
      EXPECT_EQ(shared->report().photonsLanded, whole->report().photonsLanded);
      EXPECT_EQ(photonsOfOthers(group.leader()) + group.leader().rows()[0].photons, 40000u);
      byOthers += photonsOfOthers(group.leader());
    }
    EXPECT_GT(byOthers, 0u) << "guided " << guided;
    if (model == models[2]) {  // what paths read is known to have turned seldom enough
      EXPECT_LT(whole->light().cache()->shareOfTurns(vec3(0.0f, -1.9f, 0.0f), 2), 1.0f);
    }
  }
}

TEST(MachinePhotons, OfOneThatDoesNotAnswerAreShotAgain) {
  setLogLevel(LogLevel::kQuiet);
  RenderSettings s = manyPhotons();
  s.photons = 400000;
  const auto whole = sessionOf(skylight(), s);
  whole->run();
  Net net(3, 21);
  Group group(net, skylight(), s);
  group.leader().waitForModels(kGoOn);
  net.muteAfter(1, Kind::kAtPhotons);
  group.leader().beginView(0);
  const auto shared = sessionOf(skylight(), s);
  shared->shareSamples(&group.leader());
  shared->run();
  EXPECT_EQ(shared->picture().values, whole->picture().values);
  EXPECT_EQ(group.leader().rows()[1].photons, 0u);
  net.hearAgain();  // it can be told to stop
}

TEST(MachinePhotons, StoppingAndGoingOnChangesNoBit) {
  Net net(3, 22);
  expectSameAfterStops(net, skylight(), manyPhotons(), 2);
}

// ---- what they say ----

ShotPhotons some(std::uint32_t first, std::uint32_t count) {
  ShotPhotons photons;
  for (std::uint32_t i = first; i < first + count; ++i) {
    photons.records.push_back({vec3(float(i)), i, vec3(1.0f), i + shaderio::kLastLanding});
    photons.turns.push_back(static_cast<std::uint8_t>(i % 7));
    photons.lessons.push_back({vec4(0.5f), 1.0f, 2.0f, i});
  }
  return photons;
}

TEST(MachinePhotons, PartsJoinInTheirOrderAndCountOnce) {
  PhotonParts parts({.first = 100, .end = 130});
  EXPECT_TRUE(parts.add(120, 130, some(120, 10)));
  EXPECT_FALSE(parts.add(120, 130, some(120, 10)));
  EXPECT_FALSE(parts.add(115, 125, some(115, 10)));  // some of them are there
  EXPECT_FALSE(parts.add(90, 100, some(90, 10)));    // of another batch
  EXPECT_FALSE(parts.add(110, 110, {}));
  EXPECT_TRUE(parts.add(100, 110, some(100, 10)));
  EXPECT_FALSE(parts.whole());
  EXPECT_TRUE(parts.add(110, 120, some(110, 10)));
  EXPECT_TRUE(parts.whole());
  const ShotPhotons all = parts.joined();
  ASSERT_EQ(all.records.size(), 30u);
  for (std::uint32_t i = 0; i < 30; ++i) {
    EXPECT_EQ(all.records[i].normal, 100 + i);
    EXPECT_EQ(all.lessons[i].source, 100 + i);
    EXPECT_EQ(all.turns.at(i), (100 + i) % 7);
  }
}

TEST(MachinePhotons, JobsCoverABatchAndTheirResultsAreMessages) {
  for (const bool waits : {false, true}) {
    const PhotonBatch batch{1000, 1000 + (1u << 18) - 100, waits};
    JobLedger ledger(3);
    for (std::uint32_t m = 0; m < 3; ++m) ledger.join(m);
    ledger.start(0, unitsOf(batch), photonJobSizes(batch, 3));
    std::uint64_t next = batch.first;
    for (std::uint32_t turn = 0; next < batch.end; ++turn) {
      ASSERT_LT(turn, 10000u);
      const auto job = ledger.deal(turn % 3, 0.0);
      if (!job) continue;
      const PhotonBatch part = photonsOf(*job, batch);
      EXPECT_EQ(part.first, next);
      // Every photon may land so often, and teach each time.
      EXPECT_LT((part.end - part.first) * kPhotonBounces * (32 + 1 + 28), kMostBytes);
      next = part.end;
      ledger.bring(turn % 3, job->id, 1e-3);
    }
    EXPECT_EQ(next, batch.end);
  }
}

TEST(MachinePhotons, WhatCanNotBePhotonsIsRefused) {
  EXPECT_NO_THROW(checkPhotons(some(100, 10), 100, 110));
  EXPECT_THROW(checkPhotons(some(100, 10), 101, 110), MessageError);
  EXPECT_THROW(checkPhotons(some(100, 10), 100, 109), MessageError);
  const auto refused = [](const std::function<void(ShotPhotons&)>& change) {
    ShotPhotons bad = some(100, 10);
    change(bad);
    EXPECT_THROW(checkPhotons(bad, 100, 110), MessageError);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  refused([](ShotPhotons& p) { std::swap(p.records[3], p.records[4]); });
  refused([&](ShotPhotons& p) { p.records[3].position.y = nan; });
  refused([](ShotPhotons& p) { p.records[3].power.z = -1.0f; });
  refused([&](ShotPhotons& p) { p.records[3].power.x = nan; });
  refused([](ShotPhotons& p) { p.turns.pop_back(); });
  refused([&](ShotPhotons& p) { p.lessons[9].density = 0.0f; });
  refused([&](ShotPhotons& p) { p.lessons[9].visits = nan; });
  refused([&](ShotPhotons& p) { p.lessons[9].primary.w = 1.5f; });
}

}  // namespace
}  // namespace trex::machines
