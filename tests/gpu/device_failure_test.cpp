// A device that runs out of memory or is lost: the message, no hang, nothing leaked (the validation
// layer, which the whole program runs under, tells of objects left behind).
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "src/core/error.h"
#include "src/core/log.h"
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

// --- The C++ tracer takes over ------------------------------------------------------------------

using Results = std::vector<shaderio::GatherResult>;

constexpr std::uint32_t kPhotons = 20'000;

/// What a session does: photons until the light is resolved (again, where flux was lost), then
/// batches of cones, two at a time, with more photons between.
struct Frame {
  Results cones[3];
  std::vector<asvo::uvec4> light;
  int resolves = 0;
};

Frame session(GRayTracer& tracer) {
  const auto records = test::pointLight(tree(), {2.0f, 2.7f, 1.8f}, 10.0f, kPhotons);
  const auto queries = test::roomQueries(tree(), 3'000);
  Frame frame;
  const auto resolve = [&] {
    do {
      int losses = -1;
      while (losses != tracer.fluxLosses()) {  // all of them, and none that was lost
        losses = tracer.fluxLosses();
        tracer.resetFlux();
        tracer.tracePhotons(std::span(records).first(records.size() / 2), 1e-6);
        tracer.tracePhotons(std::span(records).subspan(records.size() / 2), 1e-6);
      }
      ++frame.resolves;
    } while (!tracer.resolveLight(kPhotons, [] { return true; }));
  };
  const auto take = [&](int ticket, Results& to) {
    const auto results = tracer.finishGather(ticket);
    to.assign(results.begin(), results.end());
  };
  resolve();
  const int first = tracer.submitGather(queries);
  const int second = tracer.submitGather(queries);
  take(first, frame.cones[0]);
  const int third = tracer.submitGather(queries);
  take(second, frame.cones[1]);
  take(third, frame.cones[2]);
  frame.light.assign(tracer.light().begin(), tracer.light().end());
  return frame;
}

double sum(const Results& results) {
  double out = 0.0;
  for (const shaderio::GatherResult& r : results) out += r.radiance.x;
  return out;
}

/// Fails the first call, the second, ...: every frame is complete and like the C++ tracer's. How
/// many frames were taken over.
int takeOverAtEachCall(std::uint64_t VulkanLimits::*which, const VulkanLimits& base) {
  setLogLevel(LogLevel::kError);  // a warning each
  const auto cpu = makeCpuTracer(tree(), {});
  const Frame expected = session(*cpu);
  int replaced = 0;
  for (std::uint64_t n = 1; n < 200; ++n) {
    VulkanLimits limits = base;
    limits.*which = n;
    std::unique_ptr<GRayTracer> tracer;
    try {
      tracer = makeFallbackTracer(makeVulkanTracer(tree(), {}, -1, limits));
    } catch (const Error&) {
      continue;  // a device that does not even start
    }
    const Frame frame = session(*tracer);
    const bool taken = tracer->name().find(", then cpu") != std::string::npos;
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(frame.cones[i].size(), expected.cones[i].size());
      std::size_t different = 0;
      for (std::size_t k = 0; k < frame.cones[i].size(); ++k) {
        EXPECT_TRUE(std::isfinite(frame.cones[i][k].radiance.x));
        const float through = expected.cones[i][k].transmittance;
        different += std::abs(frame.cones[i][k].transmittance - through) > 1e-3f ? 1 : 0;
      }
      // With pages missing the device's answers are coarser.
      if (base.maxBytes == 0) {
        EXPECT_LE(different, frame.cones[i].size() / 100) << "call " << n << ", batch " << i;
        EXPECT_NEAR(sum(frame.cones[i]) / sum(expected.cones[i]), 1.0, 0.02)
            << "call " << n << ", batch " << i;
      }
    }
    // The device's photons scatter otherwise at some edges: noise. The C++ tracer's are the same.
    const float front = asvo::Tracer(tree()).asvoUnpackRgb9e5(frame.light[0].x).x;
    const float wanted = asvo::Tracer(tree()).asvoUnpackRgb9e5(expected.light[0].x).x;
    EXPECT_NEAR(front / wanted, 1.0f, 0.02f) << "call " << n;
    EXPECT_EQ(tracer->statistics().cones, 9'000u);
    if (!taken) return replaced;
    ++replaced;
  }
  ADD_FAILURE() << "a frame makes too many calls";
  return replaced;
}

TEST(DeviceFallback, AtAnyAllocation) {
  EXPECT_GT(takeOverAtEachCall(&VulkanLimits::failAllocation, {}), 3);
}

TEST(DeviceFallback, AtAnySubmit) {
  for (const bool staging : {false, true}) {
    EXPECT_GT(takeOverAtEachCall(&VulkanLimits::failSubmit, {.forceStaging = staging}), 3);
  }
}

TEST(DeviceFallback, AtAnyWait) {
  for (const bool staging : {false, true}) {
    EXPECT_GT(takeOverAtEachCall(&VulkanLimits::failWait, {.forceStaging = staging}), 3);
  }
}

TEST(DeviceFallback, InPages) {
  const VulkanLimits paged{.maxBytes = 1 << 20, .forceStaging = true, .pageBits = 8};
  EXPECT_GT(takeOverAtEachCall(&VulkanLimits::failSubmit, paged), 3);
  EXPECT_GT(takeOverAtEachCall(&VulkanLimits::failWait, paged), 3);
}

/// The last light stays, at its address, until the photons since the loss are resolved.
TEST(DeviceFallback, LightStaysUntilTheNextResolve) {
  const auto records = test::pointLight(tree(), {2.0f, 2.7f, 1.8f}, 10.0f, kPhotons);
  const auto queries = test::roomQueries(tree(), 1'000);
  // The wait that fails is one for cones. How many there are before depends on the time photons
  // take.
  for (std::uint64_t n = 1; n < 50; ++n) {
    const auto tracer = makeFallbackTracer(makeVulkanTracer(tree(), {}, -1, {.failWait = n}));
    const auto taken = [&] { return tracer->name().find(", then cpu") != std::string::npos; };
    tracer->tracePhotons(records, 1e-6);
    if (!tracer->resolveLight(kPhotons, [] { return true; }) || taken()) continue;
    const std::span<const asvo::uvec4> before = tracer->light();
    const std::vector<asvo::uvec4> copy(before.begin(), before.end());
    std::span<const shaderio::GatherResult> answers;
    while (!taken()) answers = tracer->finishGather(tracer->submitGather(queries));
    EXPECT_GT(answers[0].radiance.x + answers[1].radiance.x, 0.0f) << "black";
    EXPECT_EQ(tracer->fluxLosses(), 1);
    EXPECT_EQ(tracer->light().data(), before.data());
    EXPECT_TRUE(std::equal(copy.begin(), copy.end(), before.begin()));
    // Half of the photons: divided by their number the light is about as bright.
    tracer->tracePhotons(std::span(records).first(records.size() / 2), 1e-6);
    EXPECT_TRUE(tracer->resolveLight(kPhotons / 2, [] { return true; }));
    const asvo::Tracer unpack(tree());
    EXPECT_NEAR(unpack.asvoUnpackRgb9e5(tracer->light()[0].x).x,
                unpack.asvoUnpackRgb9e5(copy[0].x).x, 0.03f * unpack.asvoUnpackRgb9e5(copy[0].x).x);
    return;
  }
  ADD_FAILURE() << "the first cones never failed";
}

}  // namespace
}  // namespace trex
