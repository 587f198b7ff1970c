// Which samples are gathered by cones, and what share of them `--guess auto` takes.
#include "src/session/cone_share.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "src/session/session.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 72;
constexpr const char* kGpu = "a GPU";

/// A lit room.
std::shared_ptr<const Model> roomModel() {
  static const auto model = [] {
    Scene scene;
    scene.materials = {test::lambert(0.6f), test::lambert(0.0f, 8.0f)};
    test::place(scene, test::box(vec3(-2.0f), vec3(2.0f), 0, true));
    test::place(scene, test::box(vec3(-0.5f, 1.8f, -0.5f), vec3(0.5f, 1.9f, 0.5f), 1, false));
    test::place(scene, test::sphere(vec3(0.8f, 0.0f, -1.0f), 0.6f, 0, 12));
    scene.cameras = {test::lookAt(dvec3(0.0, 0.0, 1.9), dvec3(0.0, 0.0, -1.0), 1.0f)};
    return std::make_shared<const Model>(makeModel(scene, {.voxels = true, .voxelDepth = 5}));
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

/// Light that is known everywhere.
class EvenLight : public CachedLight {
 public:
  float leafSize() const override { return 0.01f; }
  bool irradiance(const vec3&, const vec3&, float, vec2, vec3& out) const override {
    out = vec3(1.0f);
    return true;
  }
};

/// Pairs know the bias of both: of their samples as many are by cones as of the others, whatever
/// share they are themselves.
TEST(ConeShare, PairsHaveTheirPartOfBoth) {
  const EvenLight light;
  const Session session(roomModel(), roomModel()->scene.cameras.front(), settings(GuessKind::kRay));
  const auto asking = [&](double share, const std::vector<PathJob>& jobs) {
    GuessOptions guess;
    guess.cache = &light;
    guess.coneShare = share;
    const PathTracer tracer(roomModel()->scene, session.rays(), session.lights(),
                            session.cameraRays(), guess, 5);
    std::vector<PathSample> samples(jobs.size());
    std::vector<RayCounts> counts(jobs.size());
    Cones cones;
    tracer.trace(jobs, kSide, 0, samples, counts, cones);
    std::vector<bool> asks(jobs.size(), false);
    for (const ConeRequest& r : cones.requests) asks[r.job] = true;
    return asks;
  };
  for (const double exact : {0.25, 0.5}) {
    std::vector<PathJob> jobs;
    for (std::uint32_t y = 0; y < kSide; y += 2) {
      for (std::uint32_t x = 0; x < kSide; x += 2) {
        for (std::uint32_t sample = 0; sample < 16; ++sample)
          jobs.push_back({x, y, sample, takesExact(sample, exact, 0.5)});
      }
    }
    const std::vector<bool> all = asking(1.0, jobs), half = asking(0.5, jobs);
    for (const bool paired : {false, true}) {
      double of = 0.0, asked = 0.0;
      for (std::size_t i = 0; i < jobs.size(); ++i) {
        ASSERT_LE(half[i], all[i]);
        if (jobs[i].paired != paired || !all[i]) continue;
        of += 1.0;
        asked += half[i] ? 1.0 : 0.0;
      }
      ASSERT_GT(of, 1000.0);
      EXPECT_NEAR(asked / of, 0.5, 5.0 * 0.5 / std::sqrt(of)) << exact << ' ' << paired;
    }
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
