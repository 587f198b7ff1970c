// Which samples are gathered by cones, and what share of them `--guess auto` takes.
#include "src/session/cone_share.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "src/session/session.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 72;
constexpr const char* kGpu = "a GPU";

/// A lit room, with and without a window to a sky.
std::shared_ptr<const Model> roomModel() {
  static const auto model = [] {
    Scene scene;
    scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 8.0f)};
    test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
    test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
    test::place(scene, test::sphere(vec3(0.8f, 0.0f, -1.0f), 0.6f, 0, 12));
    scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
    return std::make_shared<const Model>(makeModel(scene, {.voxels = true, .voxelDepth = 6}));
  }();
  return model;
}

RenderSettings settings(GuessKind guess, double share = 0.0, double exact = 0.0,
                        std::uint32_t samples = 1) {
  RenderSettings s;
  s.width = s.height = kSide;
  s.samples = samples;
  s.exact = exact;
  s.device = RenderSettings::kNoDevice;
  s.guess = guess;
  s.coneShare = share;
  return s;
}

std::unique_ptr<Session> rendered(const RenderSettings& s) {
  auto made = std::make_unique<Session>(roomModel(), roomModel()->scene.cameras.front(), s);
  made->run();
  return made;
}

/// Every sample is, to the bit, that of a picture by rays alone or by cones alone, as many by cones
/// as was asked for.
TEST(ConeShare, EachSampleIsOneOfBoth) {
  const std::vector<float> rays = rendered(settings(GuessKind::kRay))->picture().values,
                           cones = rendered(settings(GuessKind::kCone))->picture().values;
  for (const double share : {0.0, 0.1, 0.5, 0.9, 1.0}) {
    const auto mixed = rendered(settings(GuessKind::kMixed, share));
    EXPECT_EQ(mixed->coneShare(), share);
    const std::vector<float> values = mixed->picture().values;
    ASSERT_EQ(values.size(), rays.size());
    std::size_t differ = 0, byCones = 0;
    for (std::size_t i = 0; i < values.size(); i += 3) {
      const auto is = [&](const std::vector<float>& of) {
        return std::equal(of.begin() + static_cast<std::ptrdiff_t>(i),
                          of.begin() + static_cast<std::ptrdiff_t>(i) + 3,
                          values.begin() + static_cast<std::ptrdiff_t>(i));
      };
      ASSERT_TRUE(is(rays) || is(cones)) << "share " << share << ", pixel " << i / 3;
      if (is(rays) && is(cones)) continue;
      ++differ;
      byCones += is(cones) ? 1 : 0;
    }
    ASSERT_GT(differ, kSide * kSide / 2u);
    const double n = static_cast<double>(differ);
    // Five standard deviations of a coin thrown for each.
    EXPECT_NEAR(static_cast<double>(byCones) / n, share,
                5.0 * std::sqrt(share * (1.0 - share) / n) + 1e-9);
    EXPECT_EQ(mixed->report().rays.cones > 0, share > 0.0);
    EXPECT_EQ(mixed->report().rays.deviceCones, 0u);
  }
}

/// Pairs know the bias of both: their samples are by cones as often as others.
TEST(ConeShare, PairsHaveTheirPartOfBoth) {
  for (const double exact : {0.25, 0.5}) {
    const auto count = [&](double share) {
      return static_cast<double>(
          rendered(settings(GuessKind::kMixed, share, exact, 16))->report().rays.cones);
    };
    // Where pairs were all by cones, or none, the mean of the corrected picture would be off.
    EXPECT_NEAR(count(0.5) / count(1.0), 0.5, 0.02);
  }
  const auto mean = [](const RenderSettings& s) {
    double sum = 0.0;
    for (const float v : rendered(s)->picture().values) sum += static_cast<double>(v);
    return sum;
  };
  const double truth = mean(settings(GuessKind::kRay, 0.0, 1.0, 64));
  for (const double share : {0.0, 0.5, 1.0}) {
    EXPECT_NEAR(mean(settings(GuessKind::kMixed, share, 0.5, 64)) / truth, 1.0, 0.01) << share;
  }
}

TEST(ConeShare, IsKeptOnceItIsSet) {
  const auto mixed = rendered(settings(GuessKind::kMixed, 0.5, 0.25, 4));
  Session other(roomModel(), roomModel()->scene.cameras.front(),
                settings(GuessKind::kAuto, 0.0, 0.25, 4));
  EXPECT_EQ(other.coneShare(), 0.0);  // no device
  other.setConeShare(0.5);
  EXPECT_EQ(other.coneShare(), 0.5);
  other.run();
  EXPECT_EQ(other.picture().values, mixed->picture().values);
  Session exact(roomModel(), roomModel()->scene.cameras.front(),
                settings(GuessKind::kCone, 0.0, 1.0, 1));
  exact.setConeShare(0.5);
  EXPECT_EQ(exact.coneShare(), 0.0);
}

/// A machine whose CPU traces 10 M rays a second, and a GPU that answers so many cones.
schedule::MachineRecord machine(double conesASecond) {
  schedule::MachineRecord r;
  r.name = "a machine";
  r.kinds = {"rays", "cones"};
  r.graph.memories = {{"main", 1e10}, {"device", 1e9}};
  r.graph.devices = {{"CPU", 0, 0}, {kGpu, 1, 0}};
  r.timing = schedule::TimingModel(2, 2);
  r.timing.set(0, 0, {0.0, {1e-7}});
  r.timing.set(0, 1, {0.0, {6e-8}});
  r.timing.set(1, 1, {1e-4, {1.0 / conesASecond}});
  return r;
}

TEST(ConeShare, AutoGivesADeviceAsMuchAsItTakes) {
  double before = 1.0;
  for (const double rate : {1e9, 1e8, 2e7, 5e6, 2e6, 1e6, 5e5, 1e5, 1e3}) {
    const schedule::MachineRecord record = machine(rate);
    const double share = autoConeShare(&record, kGpu, false);
    EXPECT_LE(share, before) << rate;
    // It waits for the CPU's part of the paths.
    EXPECT_EQ(share == 1.0, rate >= 2e6) << rate << ": " << share;
    before = share;
  }
  EXPECT_LT(before, 0.05);
  const schedule::MachineRecord slow = machine(5e5);
  EXPECT_GT(autoConeShare(&slow, kGpu, false), 0.1);
  EXPECT_LT(autoConeShare(&slow, kGpu, false), 0.9);
}

TEST(ConeShare, AutoWithoutTimesIsAllOrNothing) {
  const schedule::MachineRecord slow = machine(1e3);
  EXPECT_EQ(autoConeShare(nullptr, kGpu, false), 1.0);
  EXPECT_EQ(autoConeShare(&slow, "another GPU", false), 1.0);
  EXPECT_EQ(autoConeShare(&slow, "CPU", false), 1.0);  // a device that is called so
  schedule::MachineRecord none = machine(1e9);
  none.kinds = {"rays", "photons"};
  EXPECT_EQ(autoConeShare(&none, kGpu, false), 1.0);
  const schedule::MachineRecord fast = machine(1e12);
  for (const auto* record : {static_cast<const schedule::MachineRecord*>(nullptr), &fast}) {
    EXPECT_EQ(autoConeShare(record, kGpu, true), 0.0);  // on the CPU's own cores
  }
}

}  // namespace
}  // namespace trex
