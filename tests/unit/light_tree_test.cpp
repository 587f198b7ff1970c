#include "src/crays/light_tree.h"

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <random>

#include "tests/unit/chi_square.h"

namespace trex {
namespace {

/// Lights of all kinds in a cube of edge 1: triangles that face anywhere, some from both sides,
/// points, spots; a few far away, some at one place, some of next to no power.
std::vector<LightBounds> randomLights(std::uint32_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  std::vector<LightBounds> lights(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    LightBounds& l = lights[i];
    const vec3 place = i % 13 == 0 ? vec3(0.1f) : vec3(unit(random), unit(random), unit(random));
    const float size = i % 5 == 0 ? 0.0f : 0.02f * unit(random);
    l.box.extend(place - size);
    l.box.extend(place + size);
    l.axis = glm::normalize(vec3(unit(random), unit(random), unit(random)) - 0.4999f);
    l.power = i % 17 == 0 ? 1e-12f : unit(random) + 0.01f;
    l.reach = 0.5f * kPi;
    l.bothSides = i % 4 == 0;
    if (i % 5 == 0) l.spread = kPi;
    if (i % 10 == 0) l.spread = 0.3f, l.reach = 0.2f;
    if (i % 3 == 0) l.group = i / 30;
    if (i % 31 == 30) l.box = {place * 1e4f, place * 1e4f};
  }
  return lights;
}

/// What the tree chooses for a number in [0, 1): light and chance; kNoLight if none.
std::uint32_t chosenBy(const LightTree& tree, const LightTree::Cut& cut, double u, float& chance) {
  LightTree::Choice choice;
  if (!tree.choose(cut, u, choice)) return LightTree::kNoLight;
  std::uint32_t place = choice.first;
  double rest = choice.rest;
  while (place + 1 < choice.first + choice.count &&
         rest >= static_cast<double>(tree.share(place))) {
    rest -= static_cast<double>(tree.share(place++));
  }
  chance = choice.chance * tree.share(place);
  return tree.light(place);
}

constexpr std::uint32_t kSizes[] = {1, 2, 3, 48, 49, 10000};
const vec3 kPlaces[] = {vec3(0.5f), vec3(0.1f), vec3(2.0f, 0.3f, -1.0f), vec3(-40.0f, 7.0f, 3.0f)};

TEST(LightTree, ChancesAreThoseOfTheChoice) {
  for (const std::uint32_t count : kSizes) {
    const LightTree tree(randomLights(count, count));
    for (const vec3& place : kPlaces) {
      for (const vec3& normal : {vec3(0.0f), vec3(0.0f, 1.0f, 0.0f)}) {
        LightTree::Cut cut;
        tree.cut(place, normal, cut);
        for (std::uint32_t i = 0; i < 500; ++i) {
          float chance = 0.0f;
          const std::uint32_t light = chosenBy(tree, cut, (i + 0.5) / 500.0, chance);
          if (light == LightTree::kNoLight) continue;
          EXPECT_NEAR(tree.chance(cut, light) / chance, 1.0f, 1e-5f) << count;
        }
      }
    }
  }
}

TEST(LightTree, ChancesAddUpToOne) {
  for (const std::uint32_t count : kSizes) {
    const LightTree tree(randomLights(count, count + 1));
    for (const vec3& place : kPlaces) {
      LightTree::Cut cut;
      tree.cut(place, vec3(0.0f, 1.0f, 0.0f), cut);
      if (cut.count == 0) continue;
      double sum = 0.0, failed = 0.0;
      for (std::uint32_t i = 0; i < count; ++i) sum += static_cast<double>(tree.chance(cut, i));
      constexpr int kTries = 2000;
      float chance = 0.0f;
      for (int i = 0; i < kTries; ++i) {
        failed += chosenBy(tree, cut, (i + 0.5) / kTries, chance) == LightTree::kNoLight;
      }
      EXPECT_NEAR(sum + failed / kTries, 1.0, 0.01) << count;
      EXPECT_LE(sum, 1.0001);
    }
  }
}

TEST(LightTree, ChoicesFollowTheirChances) {
  for (const std::uint32_t count : {2u, 49u, 1000u}) {
    const LightTree tree(randomLights(count, 7 * count));
    LightTree::Cut cut;
    tree.cut(vec3(0.4f, 0.6f, 0.5f), vec3(0.0f, 0.0f, 1.0f), cut);
    constexpr std::uint32_t kTries = 100000;
    std::vector<double> counts(count + 1, 0.0), expected(count + 1, 0.0);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    float chance = 0.0f;
    for (std::uint32_t i = 0; i < kTries; ++i) {
      counts[std::min(chosenBy(tree, cut, unit(random), chance), count)] += 1.0;
    }
    double none = kTries;
    for (std::uint32_t i = 0; i < count; ++i) {
      expected[i] = static_cast<double>(tree.chance(cut, i)) * kTries;
      none -= expected[i];
    }
    expected[count] = none;
    EXPECT_GT(test::chiSquareP(counts, expected), 1e-3) << count;
  }
}

/// Each light that can shine on a point has a chance there, and none that is near and bright is
/// left with next to nothing.
TEST(LightTree, EveryLightThatShinesHasAChance) {
  for (const std::uint32_t count : kSizes) {
    const auto lights = randomLights(count, 5 * count + 2);
    const LightTree tree(lights);
    for (const vec3& place : kPlaces) {
      LightTree::Cut cut;
      tree.cut(place, vec3(0.0f, 1.0f, 0.0f), cut);
      double all = 0.0;
      std::vector<double> given(count, 0.0);
      for (std::uint32_t i = 0; i < count; ++i) {
        const LightBounds& l = lights[i];
        const vec3 away = place - l.box.centre();
        float cosine = glm::dot(l.axis, glm::normalize(away));
        if (l.bothSides) cosine = std::abs(cosine);
        const float beyond = std::acos(std::clamp(cosine, -1.0f, 1.0f)) - l.spread;
        if (beyond >= l.reach) continue;
        given[i] = static_cast<double>(l.power * std::cos(std::max(beyond, 0.0f)) /
                                       std::max(glm::dot(away, away), 1e-6f));
        all += given[i];
      }
      for (std::uint32_t i = 0; i < count; ++i) {
        if (!(given[i] > 1e-12 * all)) continue;
        EXPECT_GT(tree.chance(cut, i), 0.0f) << count << ' ' << i;
        if (given[i] > 0.3 * all) {
          EXPECT_GT(tree.chance(cut, i), 0.01f) << count << ' ' << i;
        }
      }
    }
  }
}

/// Lights close around a point that all face away: nodes without any weight fill no cut.
TEST(LightTree, LightsThatFaceAwayHaveNoWeight) {
  std::vector<LightBounds> lights = randomLights(20000, 9);
  const vec3 place(0.5f);
  for (LightBounds& l : lights) {
    l.axis = glm::normalize(l.box.centre() - place);
    l.spread = 0.0f;
    l.reach = 0.4f * kPi;
    l.bothSides = false;
  }
  const LightTree tree(lights);
  LightTree::Cut cut;
  tree.cut(place, vec3(0.0f), cut);
  EXPECT_LE(cut.count, LightTree::kMostCut);
  for (std::uint32_t i = 0; i < lights.size(); i += 100) EXPECT_LT(tree.chance(cut, i), 0.5f);
}

TEST(LightTree, IsTheSameEachTime) {
  const auto lights = randomLights(20000, 1);
  const LightTree a(lights), b(lights);
  LightTree::Cut cutA, cutB;
  a.cut(vec3(0.3f), vec3(0.0f), cutA);
  b.cut(vec3(0.3f), vec3(0.0f), cutB);
  for (std::uint32_t i = 0; i < 20000; i += 7) EXPECT_EQ(a.chance(cutA, i), b.chance(cutB, i));
}

TEST(LightTree, HasTheSameBitsOnEveryInstructionSet) {
  const auto lights = randomLights(3000, 11);
  const auto chancesOf = [&](const vec3& place, const vec3& normal) {
    const LightTree tree(lights);
    LightTree::Cut cut;
    tree.cut(place, normal, cut);
    std::vector<float> chances;
    for (std::uint32_t i = 0; i < lights.size(); ++i) chances.push_back(tree.chance(cut, i));
    return chances;
  };
  for (const vec3& place : kPlaces) {
    for (const vec3& normal : {vec3(0.0f), vec3(0.0f, 0.6f, 0.8f)}) {
      const std::vector<float> expected = chancesOf(place, normal);
      for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        EXPECT_EQ(chancesOf(place, normal), expected) << hwy::TargetName(target);
      }
      hwy::SetSupportedTargetsForTest(0);
    }
  }
}

/// Lamps whose places tell nothing apart are chosen by power.
TEST(LightTree, LightsAtOnePlaceAreChosenByPower) {
  std::vector<LightBounds> lights(5000);
  double sum = 0.0;
  for (std::uint32_t i = 0; i < lights.size(); ++i) {
    lights[i].box.extend(vec3(0.3f));
    lights[i].spread = kPi;
    lights[i].power = 0.1f + static_cast<float>(i % 7);
    sum += static_cast<double>(lights[i].power);
  }
  const LightTree tree(lights);
  LightTree::Cut cut;
  tree.cut(vec3(-0.4f, 0.1f, 0.0f), vec3(1.0f, 0.0f, 0.0f), cut);
  for (std::uint32_t i = 0; i < lights.size(); ++i) {
    EXPECT_NEAR(tree.chance(cut, i) / (lights[i].power / sum), 1.0, 1e-4) << i;
  }
}

TEST(LightTree, OfNothingIsEmpty) {
  const LightTree tree{std::span<const LightBounds>()};
  EXPECT_TRUE(tree.empty());
  LightTree::Cut cut;
  tree.cut(vec3(0.0f), vec3(0.0f), cut);
  EXPECT_EQ(cut.count, 0);
}

}  // namespace
}  // namespace trex
