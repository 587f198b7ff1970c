// Who has which tiles of a window's frame.
#include <gtest/gtest.h>

#include "src/machines/loans.h"

namespace trex::machines {
namespace {

std::vector<TileUnit> tile(std::uint32_t number) { return {{.tile = number, .endCell = 64}}; }

TEST(Loans, AreAsLargeAsWhatComesBackInTheTimeGiven) {
  Loans loans(2);
  EXPECT_EQ(loans.wanted(1, 0.1), 1u);  // nothing is known
  const auto first = loans.lend(1, tile(0), 1000, 0.0);
  const auto second = loans.lend(1, tile(1), 1000, 0.0);
  EXPECT_EQ(loans.wanted(1, 0.1), 0u);  // it has enough
  loans.brought(1, first, 0.1, 0.1);
  EXPECT_EQ(loans.wanted(1, 0.1), 1000u);  // before the first is in the frame
  loans.end(first);
  // The machine took as long for the second, its link ten times as long.
  loans.brought(1, second, 0.1, 1.1);
  loans.end(second);
  EXPECT_NEAR(static_cast<double>(loans.wanted(1, 1.0)), 0.5 * (10000.0 + 1000.0), 1.0);
  EXPECT_EQ(loans.samplesOf(1), 2000u);
  EXPECT_TRUE(loans.empty());
}

TEST(Loans, WhatIsLateIsTakenBackAndOwed) {
  Loans loans(3);
  const auto known = loans.lend(1, tile(0), 1000, 0.0);
  loans.brought(1, known, 0.1, 0.1);
  loans.end(known);
  const auto late = loans.lend(1, tile(4), 1000, 1.0);
  loans.lend(2, tile(5), 1000, 1.0);  // nothing is known of this one
  EXPECT_TRUE(loans.takeLate(1.15, true).empty());
  EXPECT_TRUE(loans.takeLate(1.2, false).empty());
  const auto back = loans.takeLate(1.2, true);  // 0.1 s were expected, and nothing else is to do
  ASSERT_EQ(back.size(), 1u);
  EXPECT_EQ(back[0].tile, 4u);
  EXPECT_EQ(loans.find(1, late), nullptr);
  EXPECT_EQ(loans.wanted(1, 0.1), 0u);  // it owes
  EXPECT_EQ(loans.wanted(2, 0.1), 1u);
  loans.brought(1, late, 0.1, 9.0);  // too late, but it lives
  EXPECT_GT(loans.wanted(1, 0.1), 0u);
  EXPECT_EQ(loans.takeLate(9.0, false).size(), 1u);
  EXPECT_EQ(loans.takenBack(), 2u);
}

TEST(Loans, WhatIsBackIsNotLateAndNotLost) {
  Loans loans(2);
  const auto back = loans.lend(1, tile(0), 10, 0.0);
  loans.lend(1, tile(1), 10, 0.0);
  loans.brought(1, back, 0.1, 0.1);  // and waits for the coarse frame
  const auto late = loans.takeLate(100.0, true);
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].tile, 1u);
  EXPECT_TRUE(loans.lose(1).empty());
  EXPECT_NE(loans.find(1, back), nullptr);
  EXPECT_EQ(loans.find(1, 99), nullptr);
}

TEST(Loans, WhatIsDroppedIsNotOwed) {
  Loans loans(2);
  const auto first = loans.lend(1, tile(3), 10, 0.0);
  const auto second = loans.lend(1, tile(4), 10, 0.0);
  const auto back = loans.drop(1, second);
  ASSERT_EQ(back.size(), 1u);
  EXPECT_EQ(back[0].tile, 4u);
  EXPECT_GT(loans.wanted(1, 0.1), 0u);
  EXPECT_TRUE(loans.drop(1, second).empty());  // it comes twice
  EXPECT_EQ(loans.takeLate(100.0, false).size(), 1u);
  EXPECT_EQ(loans.wanted(1, 0.1), 0u);
  EXPECT_TRUE(loans.drop(1, second).empty());
  EXPECT_EQ(loans.wanted(1, 0.1), 0u) << "it owes another one";
  EXPECT_TRUE(loans.drop(1, first).empty()) << "taken back before";
  EXPECT_GT(loans.wanted(1, 0.1), 0u);
  EXPECT_TRUE(loans.empty());
  EXPECT_EQ(loans.samplesOf(1), 0u);
}

TEST(Loans, WhatIsBackIsNotDropped) {
  Loans loans(2);
  const auto id = loans.lend(1, tile(0), 10, 0.0);
  loans.brought(1, id, 0.1, 0.1);
  EXPECT_TRUE(loans.drop(1, id).empty());
  EXPECT_NE(loans.find(1, id), nullptr);
}

TEST(Loans, ClearForgetsWhatIsOwed) {
  Loans loans(2);
  const auto id = loans.lend(1, tile(0), 10, 0.0);
  EXPECT_EQ(loans.takeLate(100.0, false).size(), 1u);
  EXPECT_EQ(loans.wanted(1, 1.0), 0u);
  loans.clear();
  EXPECT_GT(loans.wanted(1, 1.0), 0u);
  loans.brought(1, id, 0.1, 101.0);  // of before
  EXPECT_GT(loans.wanted(1, 1.0), 0u);
  EXPECT_NE(loans.lend(1, tile(0), 10, 0.0), id);
}

}  // namespace
}  // namespace trex::machines
