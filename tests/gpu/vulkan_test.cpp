// The Vulkan layer: devices, limits told before they are met, staging copies.
#include "src/vulkan/vulkan.h"

#include <gtest/gtest.h>

#include <array>
#include <numeric>
#include <vector>

#include "src/core/error.h"
#include "tests/gpu/validation.h"

namespace trex {
namespace {

[[maybe_unused]] ::testing::Environment* const kValidation =
    ::testing::AddGlobalTestEnvironment(new test::ValidationEnvironment);

/// The message of the Error(kMemoryOrDevice) that `work` throws.
template <typename Work>
std::string messageOf(const Work& work) {
  try {
    work();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::kMemoryOrDevice);
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Vulkan, ListsAUsableDevice) {
  const auto devices = vulkan::listDevices();
  ASSERT_FALSE(devices.empty()) << "install mesa-vulkan-drivers: lavapipe needs no GPU";
  bool usable = false;
  for (std::size_t i = 0; i < devices.size(); ++i) {
    EXPECT_EQ(devices[i].index, static_cast<int>(i));
    EXPECT_FALSE(devices[i].name.empty());
    EXPECT_GE(devices[i].maxStorageBufferRange, 1u << 27);  // the least that Vulkan allows
    usable = usable || devices[i].unusable.empty();
  }
  EXPECT_TRUE(usable);
}

TEST(Vulkan, MissingDeviceNamesTheWayOut) {
  for (const int index : {99, -2}) {
    const std::string message = messageOf([&] { vulkan::Device device({.index = index}); });
    EXPECT_TRUE(contains(message, std::to_string(index))) << message;
    EXPECT_TRUE(contains(message, "--device none")) << message;
  }
}

TEST(Vulkan, MissingValidationLayerIsAnError) {
  setenv("VK_LAYER_PATH", "/nonexistent", 1);
  const std::string message = messageOf([] { vulkan::Device device({}); });
  unsetenv("VK_LAYER_PATH");
  EXPECT_TRUE(contains(message, "VK_LAYER_KHRONOS_validation")) << message;
}

TEST(Vulkan, BufferBeyondARangeIsRefusedWithNeedAndLimit) {
  vulkan::Device device({.maxStorageBufferRange = 4096});
  const std::string message =
      messageOf([&] { vulkan::Buffer b(device, "the things", 5000, vulkan::Place::kDevice); });
  EXPECT_TRUE(contains(message, "the things need 5000 bytes")) << message;
  EXPECT_TRUE(contains(message, "4096")) << message;
  EXPECT_EQ(device.allocatedBytes(), 0u);
}

TEST(Vulkan, BudgetIsKeptAndGivenBack) {
  vulkan::Device device({.maxBytes = 1u << 20});
  {
    vulkan::Buffer half(device, "half", 600u << 10, vulkan::Place::kDevice);
    EXPECT_GE(device.allocatedBytes(), 600u << 10);
    const std::string message =
        messageOf([&] { vulkan::Buffer b(device, "more", 600u << 10, vulkan::Place::kHost); });
    EXPECT_TRUE(contains(message, "more need 614400 bytes")) << message;
    EXPECT_TRUE(contains(message, "--max-gpu-memory")) << message;
  }
  EXPECT_EQ(device.allocatedBytes(), 0u);
  vulkan::Buffer again(device, "more", 600u << 10, vulkan::Place::kHost);
}

TEST(Vulkan, HugeSizesDoNotWrapAround) {
  vulkan::Device device({});
  const std::string message = messageOf([&] {
    vulkan::Buffer b(device, "everything", ~std::uint64_t{0} - 3, vulkan::Place::kDevice);
  });
  EXPECT_TRUE(contains(message, "everything need 18446744073709551612 bytes")) << message;
}

class Copies : public ::testing::TestWithParam<bool> {};

TEST_P(Copies, RoundTripThroughMappedAndStagedMemory) {
  vulkan::Device device({.forceStaging = GetParam()});
  constexpr std::size_t kWords = 5'000'000;  // more than two staging buffers
  vulkan::Buffer buffer(device, "words", kWords * 4, vulkan::Place::kDevice);
  std::vector<std::uint32_t> words(kWords), back(kWords, 7);
  std::iota(words.begin(), words.end(), 1u);
  buffer.upload(std::as_bytes(std::span(words)));
  buffer.upload(std::as_bytes(std::span(words).first(3)), 40);
  buffer.download(std::as_writable_bytes(std::span(back)));
  std::copy_n(words.begin(), 3, words.begin() + 10);
  EXPECT_EQ(words, back);
  buffer.clear();
  std::array<std::uint32_t, 2> last = {1, 1};
  buffer.download(std::as_writable_bytes(std::span(last)), (kWords - 2) * 4);
  EXPECT_EQ(last, (std::array<std::uint32_t, 2>{0, 0}));
}

INSTANTIATE_TEST_SUITE_P(Vulkan, Copies, ::testing::Bool());

TEST(Slicer, FollowsWhatWasMeasured) {
  vulkan::Slicer slicer(1000);
  slicer.measured(1000, 0.025);
  EXPECT_EQ(slicer.items(), 2000u);
  slicer.measured(2000, 1.0);  // a slow device: back to what fits
  EXPECT_EQ(slicer.items(), 100u);
  slicer.measured(100, 0.001);  // grows by 4 at most
  EXPECT_EQ(slicer.items(), 400u);
  slicer.measured(400, 100.0);
  EXPECT_EQ(slicer.items(), 64u);
}

}  // namespace
}  // namespace trex
