// Power of lights, hidden objects, section planes, bookmarks, the bytes of the screen.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>

#include "src/viewer/bookmarks.h"
#include "src/viewer/light_units.h"
#include "src/viewer/screen_picture.h"
#include "src/viewer/visibility.h"

namespace trex {
namespace {

TEST(LightUnits, PowerAndColourThereAndBack) {
  for (const Light::Type type :
       {Light::Type::kPoint, Light::Type::kSpot, Light::Type::kDirectional}) {
    Light light;
    light.type = type;
    setLight(light, vec3(1.0f, 0.5f, 0.25f), 60.0f);
    EXPECT_NEAR(lightPower(light), 60.0f, 1e-3f);
    EXPECT_NEAR(lightColor(light).y, 0.5f, 1e-5f);
  }
}

TEST(LightUnits, SpotsShineAsMuchAsTheirFalloffSums) {
  Light light;
  light.type = Light::Type::kSpot;
  light.innerConeAngle = 0.3f;
  light.outerConeAngle = 0.9f;
  // The same by summing rings of the falloff.
  const double inner = std::cos(0.3), outer = std::cos(0.9);
  double sum = 0.0;
  constexpr int kRings = 100000;
  for (int i = 0; i < kRings; ++i) {
    const double cosine = outer + (1.0 - outer) * (i + 0.5) / kRings;
    const double ramp = std::min((cosine - outer) / (inner - outer), 1.0);
    sum += ramp * ramp;
  }
  const double expected = 2.0 * M_PI * sum * (1.0 - outer) / kRings;
  EXPECT_NEAR(lightSolidAngle(light), expected, 1e-4);
}

TEST(LightUnits, AWholePointLightShinesAllAround) {
  EXPECT_NEAR(lightSolidAngle(Light{}), 4.0f * kPi, 1e-5f);
}

TEST(LightUnits, NewLightsSuitTheExposure) {
  Look look;
  look.camera.eye = dvec3(0.0, 0.0, 5.0);
  look.exposure = 2.0f;
  for (const Light::Type type : {Light::Type::kPoint, Light::Type::kSpot}) {
    const Light light = newLight(type, look, 5.0, 3.0);
    EXPECT_LT(light.position.z, 5.0);
    EXPECT_GT(light.position.z, 0.0);
    EXPECT_GT(light.radius, 0.0f);
    EXPECT_LE(light.innerConeAngle, light.outerConeAngle);
    const double squared = glm::dot(light.position, light.position);
    const double shown = 4.0 * 0.5 / double(kPi) * double(light.intensity.x) / squared;
    EXPECT_NEAR(shown, 0.5, 1e-4);
  }
  EXPECT_NEAR(lightPower(newLight(Light::Type::kDirectional, look, 5.0, 3.0)), kPi / 4.0f, 1e-5f);
}

TEST(LightUnits, Emission) {
  vec3 color;
  float strength = 0.0f;
  splitEmission(vec3(2.0f, 4.0f, 1.0f), color, strength);
  EXPECT_EQ(strength, 4.0f);
  EXPECT_EQ(color, vec3(0.5f, 1.0f, 0.25f));
  splitEmission(vec3(0.0f), color, strength);
  EXPECT_EQ(strength, 0.0f);
  EXPECT_EQ(color, vec3(1.0f));
}

TEST(Visibility, HiddenObjectsStaySortedAndUnique) {
  Look look;
  for (const std::uint32_t object : {5u, 1u, 3u, 5u}) setHidden(look, object, true);
  EXPECT_EQ(look.hidden, (std::vector<std::uint32_t>{1, 3, 5}));
  setHidden(look, 3, false);
  setHidden(look, 4, false);
  EXPECT_EQ(look.hidden, (std::vector<std::uint32_t>{1, 5}));
  EXPECT_TRUE(isHidden(look, 5));
  EXPECT_FALSE(isHidden(look, 3));
}

TEST(Visibility, SectionsSweepTheBox) {
  const Box3d box{dvec3(10.0, 0.0, 0.0), dvec3(20.0, 4.0, 4.0)};
  EXPECT_EQ(sectionAt(box, vec3(1.0f, 0.0f, 0.0f), 0.0).point.x, 20.0);
  EXPECT_EQ(sectionAt(box, vec3(1.0f, 0.0f, 0.0f), 1.0).point.x, 10.0);
  const vec3 slanted = glm::normalize(vec3(1.0f, 1.0f, 0.0f));
  for (const double share : {0.0, 0.3, 0.5, 1.0}) {
    EXPECT_NEAR(sectionShare(box, sectionAt(box, slanted, share)), share, 1e-6);
  }
}

TEST(Bookmarks, ThereAndBack) {
  const auto folder =
      std::filesystem::temp_directory_path() / ("trex-bookmarks-" + std::to_string(getpid()));
  const auto file = folder / "deep" / "a.views.json";
  EXPECT_TRUE(readBookmarks(file).empty());
  const std::vector<Bookmark> bookmarks{{"door", "0,0,1/0,0,0/0,1,0/40"}, {"\"quoted\"", "x"}};
  writeBookmarks(file, bookmarks);
  EXPECT_EQ(readBookmarks(file), bookmarks);
  std::ofstream(file) << "{\"trex\": 1, \"bookmarks\": 3}";
  EXPECT_TRUE(readBookmarks(file).empty());
  std::filesystem::remove_all(folder);
}

TEST(Bookmarks, EachModelHasItsOwnFile) {
  setenv("XDG_STATE_HOME", "/state", 1);
  EXPECT_NE(bookmarksFile("/a/model.glb"), bookmarksFile("/b/model.glb"));
  EXPECT_EQ(bookmarksFile("/a/model.glb").parent_path(), "/state/trex/views");
}

/// The screen's table gives the bytes that a file would have, for every operator.
TEST(ScreenPicture, ShowsTheBytesOfAFile) {
  std::vector<vec3> linear;
  for (float x = 1e-6f; x < 100.0f; x *= 1.003f)
    linear.emplace_back(x, 0.3f * x, 2.0f / (1.0f + x));
  linear.emplace_back(std::nanf(""), -1.0f, kInfinity);
  for (const ToneOperator op : {ToneOperator::kCut, ToneOperator::kNeutral, ToneOperator::kAgx}) {
    const ToneMap toneMap{-0.7f, op};
    std::vector<std::uint8_t> rgba;
    toneMapTo(linear, toneMap, rgba);
    for (std::size_t i = 0; i < linear.size(); ++i) {
      const vec3 expected = toneMap.apply(linear[i]) * 255.0f;
      for (int c = 0; c < 3; ++c) {
        ASSERT_EQ(rgba[4 * i + static_cast<std::size_t>(c)], std::lround(expected[c])) << i;
      }
    }
  }
}

}  // namespace
}  // namespace trex
