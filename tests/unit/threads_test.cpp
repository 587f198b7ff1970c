#include "src/core/threads.h"

#include <gtest/gtest.h>

namespace trex {
namespace {

TEST(Threads, TheLimitOfTheProcessAndTheArenaBothCount) {
  const int all = threadsAllowed();
  EXPECT_GE(all, 1);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(threadsAllowed(), 1);
  }
  EXPECT_EQ(threadsAllowed(), all);
  const tbb::global_control many(tbb::global_control::max_allowed_parallelism, 64);
  tbb::task_arena(3).execute([] { EXPECT_EQ(threadsAllowed(), 3); });
  tbb::task_arena(1).execute([] { EXPECT_EQ(threadsAllowed(), 1); });
}

}  // namespace
}  // namespace trex
