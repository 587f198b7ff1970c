// Light that is remembered: how much it is worth, where, and what forgets it.
#include "src/frame/light_memory.h"

#include <gtest/gtest.h>

#include "src/core/sampler.h"

namespace trex {
namespace {

Feature floorAt(float x, float z, float footprint = 0.01f) {
  Feature f;
  f.normal = vec3(0, 1, 0);
  f.position = vec3(x, 0.5f, z);
  f.albedo = vec3(0.5f, 0.25f, 0.75f);
  f.footprint = footprint;
  return f;
}

/// A floor of 1 m, lit by 3 +- noise where nothing is dark.
LightMemory memoryOfAFloor(float footprint) {
  LightMemory memory;
  Sampler sampler(0, 0, 7);
  for (int i = 0; i < 200'000; ++i) {
    const vec2 at = sampler.next2D();
    const Feature f = floorAt(at.x, at.y, footprint);
    memory.add(f, 6.0f * sampler.next1D() * f.albedo);
  }
  return memory;
}

FeaturePart one(const Feature& f, float light) {
  FeaturePart part;
  part.add(f, light * f.albedo);
  return part;
}

TEST(LightMemory, JoinsWhatItsCellsAreWorth) {
  const LightMemory memory = memoryOfAFloor(0.01f);
  Sampler sampler(0, 0, 9);
  double sum = 0.0;
  int joined = 0;
  constexpr int kPixels = 2000;
  for (int i = 0; i < kPixels; ++i) {
    const vec2 at = 0.1f + 0.8f * sampler.next2D();
    Feature f = floorAt(at.x, at.y);
    f.albedo = vec3(0.9f, 0.1f, 0.2f);  // another texel
    FeaturePart part = one(f, 0.0f);
    if (!memory.join(part, sampler.next2D())) continue;
    ++joined;
    EXPECT_GT(part.count, 4.0f);
    EXPECT_LT(part.count, 1.0f + 64.0f);
    const vec3 plain = part.light * part.count / (part.count - 1.0f) / f.albedo;
    EXPECT_NEAR(plain.x, plain.y, 1e-4f);
    sum += static_cast<double>(plain.x);
    // 6 u has variance 3, less what the mean may be wrong by.
    EXPECT_NEAR(part.variance().x / (f.albedo.x * f.albedo.x) * part.count, 3.0f, 2.5f);
  }
  EXPECT_GT(joined, kPixels * 95 / 100);
  EXPECT_NEAR(sum / joined, 3.0, 0.05);
}

TEST(LightMemory, SeesFromNearerAndFartherOff) {
  const LightMemory memory = memoryOfAFloor(0.01f);
  for (const float footprint : {0.0026f, 0.005f, 0.02f}) {
    FeaturePart part = one(floorAt(0.5f, 0.5f, footprint), 1.0f);
    EXPECT_TRUE(memory.join(part, vec2(0.5f))) << footprint;
  }
  for (const float footprint : {0.0005f, 0.1f}) {
    FeaturePart part = one(floorAt(0.5f, 0.5f, footprint), 1.0f);
    EXPECT_FALSE(memory.join(part, vec2(0.5f))) << footprint;
  }
}

TEST(LightMemory, KnowsNothingOfOtherSidesMetalAndNothing) {
  LightMemory memory = memoryOfAFloor(0.01f);
  Feature below = floorAt(0.5f, 0.5f), metal = below, nothing{}, black = below;
  below.normal = -below.normal;
  metal.albedo = vec3(1.0f);
  black.black = 1.0f;
  for (const Feature& f :
       {below, metal, nothing, black, floorAt(5.0f, 0.5f), floorAt(1e30f, 0.0f)}) {
    FeaturePart part = one(f, 1.0f);
    memory.add(f, vec3(1.0f));
    const FeaturePart before = part;
    EXPECT_FALSE(memory.join(part, vec2(0.5f)));
    EXPECT_EQ(part.light, before.light);
  }
  memory.clear();
  FeaturePart part = one(floorAt(0.5f, 0.5f), 1.0f);
  EXPECT_FALSE(memory.join(part, vec2(0.5f)));
}

/// More places than it has cells: it forgets, and stays right.
TEST(LightMemory, IsBounded) {
  LightMemory memory;
  Sampler sampler(0, 0, 3);
  for (int i = 0; i < 3'000'000; ++i) {
    const vec2 at = 1e4f * sampler.next2D();
    memory.add(floorAt(at.x, at.y, 1.0f), vec3(1.0f));
  }
  for (int round = 0; round < 40; ++round) {
    memory.add(floorAt(0.5f, 0.5f), vec3(round % 2 == 0 ? 0.5f : 1.5f) * floorAt(0, 0).albedo);
  }
  FeaturePart part = one(floorAt(0.5f, 0.5f), 1.0f);
  ASSERT_TRUE(memory.join(part, vec2(0.5f)));
  EXPECT_NEAR(part.light.x / 0.5f, 1.0f, 0.1f);
}

}  // namespace
}  // namespace trex
