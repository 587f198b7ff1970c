// Turns validation on for a whole test program; any message fails it.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

#include "src/vulkan/vulkan.h"

namespace trex::test {

class ValidationEnvironment : public ::testing::Environment {
 public:
  void SetUp() override { setenv("TREX_VALIDATION", "1", 1); }
  void TearDown() override {
    EXPECT_EQ(vulkan::validationMessages(), 0u) << "the validation layer had something to say";
  }
};

}  // namespace trex::test
