// Pages that come behind rays which do not wait: units that miss some come to nothing, and the
// picture has the same bits in the end.
#include <gtest/gtest.h>

#include "src/core/clock.h"
#include "src/core/error.h"
#include "src/session/session.h"
#include "tests/unit/paged_scenes.h"

namespace trex {
namespace {

using test::lambert;

constexpr std::uint32_t kWidth = 150, kHeight = 90;  // six tiles

std::vector<Material> matte() { return {lambert(0.6f), lambert(0.3f), lambert(0.8f)}; }

std::shared_ptr<const Model> modelOf(test::Paged made) {
  auto model = std::make_shared<Model>();
  model->scene = std::move(made.scene);
  model->rays = std::move(made.rays);
  return model;
}

std::unique_ptr<Session> windowOf(const std::shared_ptr<const Model>& model) {
  RenderSettings s;
  s.width = kWidth;
  s.height = kHeight;
  s.samples = 3;
  s.exact = 1.0;
  s.device = RenderSettings::kNoDevice;
  s.interactive = true;
  return std::make_unique<Session>(model, model->scene.cameras.front(), s);
}

void settle(Session& session) {
  while (!session.resting()) {
    const double until = secondsNow() + 0.005;
    session.step([&] { return secondsNow() < until; }, vec2(0.4f, 0.6f));
  }
}

TEST(PagesBehind, AWindowSettlesToTheSamePictureHoweverFewPagesHaveRoom) {
  const auto all = modelOf(test::paged(matte(), 10'000));
  const auto waits = windowOf(all);
  settle(*waits);
  for (const std::uint64_t pages : {10'000, 12, 3}) {
    const auto model = modelOf(test::paged(matte(), pages, false, false, nullptr, 0.00005, 4));
    model->rays->parts().paged->fetchBehind();
    const auto behind = windowOf(model);
    settle(*behind);
    EXPECT_EQ(behind->picture().values, waits->picture().values) << pages << " pages";
    EXPECT_GT(model->rays->missed(), 0u) << pages << " pages";
    EXPECT_LE(model->rays->pageStatistics().peakBytes, model->rays->parts().paged->cacheBytes());
  }
}

TEST(PagesBehind, AnotherViewWhilePagesAreOnTheirWay) {
  const auto all = modelOf(test::paged(matte(), 10'000));
  const auto model = modelOf(test::paged(matte(), 40, false, false, nullptr, 0.0005));
  model->rays->parts().paged->fetchBehind();
  const auto waits = windowOf(all), behind = windowOf(model);
  Camera camera = all->scene.cameras.front();
  for (int i = 0; i < 12; ++i) {
    camera.eye.x -= 0.05;
    for (Session* session : {waits.get(), behind.get()}) {
      session->follow({.frame = true}, camera);
      for (int step = 0; step < i % 3; ++step) session->step([] { return false; }, vec2(0.5f));
    }
  }
  settle(*waits);
  settle(*behind);
  EXPECT_EQ(behind->picture().values, waits->picture().values);
}

TEST(PagesBehind, OneThatCanNotBeReadEndsTheStepWithItsPlace) {
  const auto model = modelOf(test::paged(matte(), 10'000, false, true));
  model->rays->parts().paged->fetchBehind();
  const auto session = windowOf(model);
  try {
    settle(*session);
    FAIL() << "nothing was thrown";
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
  }
}

TEST(PagesBehind, OthersOfTheMeshStillWait) {
  const auto model = modelOf(test::paged(matte(), 10'000, false, false, nullptr, 0.0002));
  model->rays->parts().paged->fetchBehind();
  const auto session = windowOf(model);
  // A pick between two steps.
  dvec3 origin;
  vec3 direction;
  session->cameraRays().ray(75.0f, 45.0f, origin, direction);
  RayHit hit;
  EXPECT_TRUE(model->rays->intersect(origin, direction, 0.0f, kInfinity, hit));
  EXPECT_EQ(model->rays->missed(), 0u);
}

}  // namespace
}  // namespace trex
