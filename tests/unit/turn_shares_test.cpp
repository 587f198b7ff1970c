#include "src/crays/turn_shares.h"

#include <gtest/gtest.h>

namespace trex {
namespace {

Box3f unitBox() { return {vec3(0.0f), vec3(1.0f)}; }

TEST(TurnShares, OfNothingAreAll) {
  EXPECT_EQ(TurnShares().at(vec3(0.5f), 0), 1.0f);
  TurnSums none;
  none.add(vec3(0.5f), 1, 1.0f);
  EXPECT_FALSE(none.counts());
  EXPECT_EQ(none.shares().at(vec3(0.5f), 0), 1.0f);
  EXPECT_EQ(TurnSums(unitBox(), 4).shares().at(vec3(0.5f), 2), 1.0f);
}

TEST(TurnShares, AreOfTheirPlaceElseOfAll) {
  TurnSums sums(unitBox(), 3);
  EXPECT_TRUE(sums.counts());
  sums.add(vec3(0.01f), 0, 3.0f);
  sums.add(vec3(0.02f), 2, 1.0f);
  sums.add(vec3(0.99f), 3, 4.0f);
  const TurnShares shares = sums.shares();
  const float here[] = {0.75f, 0.75f, 1.0f, 1.0f}, there[] = {0.0f, 0.0f, 0.0f, 1.0f},
              elsewhere[] = {0.375f, 0.375f, 0.5f, 1.0f};
  for (std::uint32_t turns = 0; turns < 4; ++turns) {
    EXPECT_FLOAT_EQ(shares.at(vec3(0.03f), turns), here[turns]) << turns;
    EXPECT_FLOAT_EQ(shares.at(vec3(1.0f), turns), there[turns]) << turns;
    EXPECT_FLOAT_EQ(shares.at(vec3(0.5f), turns), elsewhere[turns]) << turns;
  }
  EXPECT_EQ(shares.at(vec3(0.5f), 4), 1.0f);          // more than any has turned
  EXPECT_FLOAT_EQ(shares.at(vec3(-7.0f), 0), 0.75f);  // beside the scene: the next cell
  sums.restart();
  EXPECT_EQ(sums.shares().at(vec3(0.01f), 0), 1.0f);
}

TEST(TurnShares, OfAFlatSceneToo) {
  TurnSums sums({vec3(0.0f), vec3(1.0f, 0.0f, 1.0f)}, 1);
  sums.add(vec3(0.5f, 0.0f, 0.5f), 5, 1.0f);  // counts as the most
  EXPECT_EQ(sums.shares().at(vec3(0.5f, 0.0f, 0.5f), 0), 0.0f);
  EXPECT_EQ(sums.shares().at(vec3(0.5f, 0.0f, 0.5f), 1), 1.0f);
}

}  // namespace
}  // namespace trex
