#include "src/session/run_table.h"

#include <gtest/gtest.h>

namespace trex {
namespace {

TEST(RunTable, FindsEveryNumber) {
  for (const std::uint32_t longest : {1u, 3u, 1000u}) {
    RunTable table;
    std::vector<std::pair<std::size_t, std::uint32_t>> right;
    for (std::uint32_t run = 0; run < 500; ++run) {
      // Empty ones at both ends and between; one is much longer than the others.
      const std::uint32_t length = run == 250             ? 5000u
                                   : run < 3 || run > 496 ? 0u
                                                          : run * 2654435761u % (longest + 1);
      table.add(length);
      for (std::uint32_t i = 0; i < length; ++i) right.emplace_back(run, i);
    }
    table.finish();
    ASSERT_EQ(right.size(), table.count());
    for (std::size_t i = 0; i < right.size(); ++i) {
      std::uint32_t place = 0;
      ASSERT_EQ(right[i].first, table.find(i, place)) << i;
      ASSERT_EQ(right[i].second, place) << i;
    }
  }
}

TEST(RunTable, MayBeEmpty) {
  RunTable table;
  table.add(0);
  table.finish();
  EXPECT_EQ(0u, table.count());
}

}  // namespace
}  // namespace trex
