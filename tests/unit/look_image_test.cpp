// What pixels show by their first samples: each counts once, and more are asked for where they tell
// more.
#include "src/frame/look_image.h"

#include <gtest/gtest.h>

namespace trex {
namespace {

Feature wall(float albedo, bool left = true) {
  Feature f;
  f.albedo = vec3(albedo);
  f.normal = left ? vec3(1, 0, 0) : vec3(0, 0, 1);
  f.footprint = 0.01f;
  return f;
}

TEST(LookImage, CountsEachNumberOnce) {
  LookImage looks(2, 1);
  looks.add(0, 0, 1, wall(0.9f), vec3(0.0f));  // none before it
  EXPECT_EQ(looks.count(0, 0), 0u);
  looks.add(0, 0, 0, wall(0.2f), vec3(1.0f));
  looks.add(0, 0, 0, wall(0.9f), vec3(9.0f));
  looks.add(0, 0, 1, wall(0.4f), vec3(3.0f));
  EXPECT_EQ(looks.count(0, 0), 2u);
  EXPECT_EQ(looks.count(1, 0), 0u);
  EXPECT_NEAR(looks.shown().most(0, 0).mean.albedo.x, 0.3f, 1e-6f);
  EXPECT_NEAR(looks.shown().light(0, 0).x, 2.0f, 1e-6f);
  looks.restart();
  EXPECT_EQ(looks.count(0, 0), 0u);
  for (std::uint32_t i = 0; i < 2 * LookImage::kMost; ++i)
    looks.add(0, 0, i, wall(0.7f), vec3(0.0f));
  EXPECT_EQ(looks.count(0, 0), LookImage::kMost);
  EXPECT_NEAR(looks.shown().mean(0, 0).albedo.x, 0.7f, 1e-6f);
}

TEST(LookImage, SidesOfGlassCountByTheirWeight) {
  LookImage looks(1, 1);
  looks.add(0, 0, 0, wall(0.5f), vec3(0.0f), 1.8f);
  looks.add(0, 0, 1, wall(0.5f, false), vec3(5.0f), 0.2f);
  EXPECT_NEAR(looks.shown().shareOfMost(0, 0), 0.9f, 1e-6f);
  EXPECT_NEAR(looks.shown().light(0, 0).x, 0.5f, 1e-6f);
}

/// Pixels 0 to 6: an even wall, another albedo at 3, another surface at 5, a lamp at 6.
TEST(LookImage, AsksForMoreWhereThatTellsMore) {
  const auto shows = [](std::uint32_t x) { return wall(x == 3 ? 0.8f : 0.5f, x < 5); };
  LookImage looks(8, 1);
  for (std::uint32_t x = 0; x < 7; ++x) looks.add(x, 0, 0, shows(x), vec3(x == 6 ? 4.0f : 0.0f));
  const bool expected[] = {false, false, true, true, true, true, true};
  for (std::uint32_t x = 0; x < 7; ++x) EXPECT_EQ(looks.varied(x, 0), expected[x]) << x;
  EXPECT_FALSE(looks.wants(0, 0, 1));
  EXPECT_TRUE(looks.wants(2, 0, 1));
  EXPECT_FALSE(looks.wants(2, 0, 2)) << "not the next";
  looks.add(0, 0, 1, wall(0.5f, false), vec3(0.0f));
  EXPECT_TRUE(looks.varied(0, 0)) << "two surfaces";
  EXPECT_TRUE(looks.varied(1, 0)) << "beside them";
  LookImage glass(1, 1);
  glass.add(0, 0, 0, wall(0.5f), vec3(0.0f), 1.9f);
  EXPECT_TRUE(glass.wants(0, 0, 1)) << "one side of glass";
  // A texture is worth four looks, a rim all.
  LookImage both(3, 1);
  for (std::uint32_t number = 0; number < LookImage::kMost; ++number) {
    EXPECT_EQ(number == 0 || both.wants(0, 0, number), number < 4) << number;
    EXPECT_TRUE(number == 0 || both.wants(2, 0, number)) << number;
    both.add(0, 0, number, wall(number % 2 == 0 ? 0.2f : 0.6f), vec3(0.0f));
    both.add(1, 0, number, wall(0.9f), vec3(0.0f));
    both.add(2, 0, number, wall(0.5f, number % 2 == 0), vec3(0.0f));
  }
}

}  // namespace
}  // namespace trex
