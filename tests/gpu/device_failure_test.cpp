// A device that runs out of memory or is lost: the message, no hang, nothing leaked (the validation
// layer, which the whole program runs under, tells of objects left behind).
#include <gtest/gtest.h>

#include <optional>

#include "src/core/error.h"
#include "src/vulkan/vulkan.h"
#include "tests/gpu/grays_fixture.h"

namespace trex {
namespace {

const asvo::Tree& tree() {
  static const asvo::Tree built = test::buildTree(test::furnishedRoom(), 5);
  return built;
}

/// Light, then two batches of cones under way at once: what a frame asks of a tracer.
void traceFrame(GRayTracer& tracer) {
  tracer.tracePhotons(test::pointLight(tree(), {2.0f, 2.7f, 1.8f}, 10.0f, 2000), 1e-6);
  tracer.resolveLight(2000);
  const auto queries = test::roomQueries(tree(), 20'000);
  const int first = tracer.submitGather(queries);
  const int second = tracer.submitGather(queries);
  tracer.finishGather(first);
  tracer.finishGather(second);
}

/// What the error says that a frame ends in; none if it succeeds.
std::optional<std::string> failureOf(const VulkanLimits& limits) {
  try {
    const auto tracer = makeVulkanTracer(tree(), {}, -1, limits);
    traceFrame(*tracer);
    return std::nullopt;
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::kMemoryOrDevice);
    return error.what();
  }
}

/// Fails the first call, the second, ... until a frame succeeds; how many there were.
int failEachCall(std::uint64_t VulkanLimits::*which, bool staging, const std::string& says) {
  const std::string device = vulkan::Device({}).info().name;
  for (int n = 1; n < 1000; ++n) {
    VulkanLimits limits;
    limits.forceStaging = staging;
    limits.*which = static_cast<std::uint64_t>(n);
    const auto message = failureOf(limits);
    if (!message) return n - 1;
    EXPECT_NE(message->find(says), std::string::npos) << *message;
    EXPECT_NE(message->find(device), std::string::npos) << *message;
    EXPECT_NE(message->find("--device none"), std::string::npos) << *message;
    EXPECT_EQ(message->find('\n'), std::string::npos) << *message;
  }
  ADD_FAILURE() << "a frame makes too many calls";
  return 0;
}

TEST(DeviceFailure, OutOfMemoryAtAnyAllocation) {
  EXPECT_GT(failEachCall(&VulkanLimits::failAllocation, false, "out of device memory"), 8);
}

TEST(DeviceFailure, LostAtAnySubmit) {
  for (const bool staging : {false, true}) {
    EXPECT_GT(failEachCall(&VulkanLimits::failSubmit, staging, "device was lost"), 2);
  }
}

TEST(DeviceFailure, LostAtAnyWait) {
  for (const bool staging : {false, true}) {
    EXPECT_GT(failEachCall(&VulkanLimits::failWait, staging, "device was lost"), 2);
  }
}

TEST(DeviceFailure, GivesMemoryBack) {
  vulkan::Device device({.failAllocation = 2});
  {
    vulkan::Buffer first(device, "first", 4096, vulkan::Place::kDevice);
    EXPECT_THROW(vulkan::Buffer(device, "second", 4096, vulkan::Place::kDevice), Error);
    EXPECT_GE(device.allocatedBytes(), 4096u);
  }
  EXPECT_EQ(device.allocatedBytes(), 0u);
}

TEST(DeviceFailure, ALostDeviceStaysLost) {
  vulkan::Device device({.forceStaging = true, .failSubmit = 1});
  vulkan::Buffer buffer(device, "words", 64, vulkan::Place::kDevice);
  for (int i = 0; i < 3; ++i) EXPECT_THROW(buffer.clear(), Error);
}

// A tracer that failed once may be asked again and destroyed; each call ends.
TEST(DeviceFailure, LaterCallsEnd) {
  for (std::uint64_t n = 1; n < 4; ++n) {
    const auto tracer = makeVulkanTracer(tree(), {}, -1, {.failWait = n});
    for (int i = 0; i < 2; ++i) EXPECT_THROW(traceFrame(*tracer), Error);
  }
}

}  // namespace
}  // namespace trex
