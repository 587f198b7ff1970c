#include "src/scene/daylight.h"

#include <gtest/gtest.h>

#include <numbers>

namespace trex::detail {
namespace {

/// Irradiance of level ground below a map with +y up.
dvec3 groundUnder(const Image& map) {
  constexpr double kPiD = std::numbers::pi;
  dvec3 sum(0.0);
  for (int y = 0; y < map.height; ++y) {
    const double theta = kPiD * (y + 0.5) / map.height;
    const double weight = std::max(std::cos(theta), 0.0) * std::sin(theta) * (kPiD / map.height) *
                          (2.0 * kPiD / map.width);
    for (int x = 0; x < map.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        sum[c] += double(map.floats[3 * (std::size_t(y) * map.width + x) + c]) * weight;
      }
    }
  }
  return sum;
}

Daylight dayAt(double degrees) {
  Daylight day;
  day.sun = {std::cos(glm::radians(degrees)), std::sin(glm::radians(degrees)), 0.0};
  return day;
}

TEST(Daylight, SkyHasItsLightOnLevelGround) {
  // As Mitsuba 3.9's `sunsky` at turbidity 3, the sun 25 degrees high.
  Daylight day = dayAt(25.0);
  const dvec3 expected(0.1354, 0.2058, 0.3073);
  const dvec3 once = groundUnder(*daylightSky(day, false).map);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(once[c] / expected[c], 1.0, 1e-3);
  day.skyScale = 6.0;
  const dvec3 six = groundUnder(*daylightSky(day, false).map);
  EXPECT_NEAR(six.y / once.y, 6.0, 1e-3);
}

TEST(Daylight, SkyIsBrightestAroundTheSunAndBlackBelow) {
  const Image map = *daylightSky(dayAt(25.0), false).map;
  const auto green = [&](const dvec3& d) {
    const double u = std::atan2(d.x, -d.z) / (2.0 * std::numbers::pi) + 0.5;
    const double v = std::acos(d.y) / std::numbers::pi;
    const int x = std::min(int(u * map.width), map.width - 1);
    const int y = std::min(int(v * map.height), map.height - 1);
    return map.floats[3 * (std::size_t(y) * map.width + x) + 1];
  };
  EXPECT_GT(green(dayAt(25.0).sun), 3.0f * green({0, 1, 0}));
  EXPECT_GT(green(glm::normalize(dvec3(-1, 0.1, 0))), green({0, 1, 0}));  // the horizon is bright
  EXPECT_EQ(green({0, -1, 0}), 0.0f);
}

TEST(Daylight, SunHasOnePowerForAnyRadius) {
  Daylight day = dayAt(45.0);
  day.skyScale = 0.0;
  const vec3 facing = sunIrradiance(day);
  EXPECT_NEAR(facing.y, 1.215f, 0.03f);
  for (const double radius : {0.02, 0.1}) {
    day.sunRadius = radius;
    const dvec3 ground = groundUnder(*daylightSky(day, true).map);
    EXPECT_NEAR(ground.y / (double(facing.y) * std::sin(glm::radians(45.0))), 1.0, 0.02);
  }
  EXPECT_EQ(sunIrradiance(dayAt(-1.0)).y, 0.0f);
}

}  // namespace
}  // namespace trex::detail
