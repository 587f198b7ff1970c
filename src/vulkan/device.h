// Insides of Device, shared by the .cpp files of src/vulkan.
#pragma once

#include <memory>
#include <string>

#include "src/vulkan/instance.h"

namespace trex::vulkan {

struct Device::Impl {
  std::shared_ptr<Instance> instance;
  DeviceFunctions f;
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  std::uint32_t family = 0;
  VkPhysicalDeviceMemoryProperties memory{};
  DeviceInfo info;
  DeviceOptions options;
  StartTimes times;
  std::uint64_t allocatedBytes = 0;
  bool lost = false;
  std::uint64_t allocations = 0, submits = 0,
                waits = 0;  ///< calls so far, for DeviceOptions::fail*

  /// Counts a call; true if it is to fail.
  static bool failsNow(std::uint64_t& calls, std::uint64_t first) {
    return ++calls >= first && first > 0;
  }
  std::uint64_t maxBytes() const;
  /// Throws unless result is VK_SUCCESS, naming the device.
  void check(VkResult result, const std::string& what);
  /// Throws if the device was lost before: its objects may be in any state.
  void requireAlive(const std::string& what) {
    if (lost) check(VK_ERROR_DEVICE_LOST, what);
  }
  ~Impl();
};

struct Buffer::Impl {
  Device* owner = nullptr;
  std::string name;
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  std::uint64_t bytes = 0, allocated = 0;
  std::byte* mapped = nullptr;
};

struct Kernel::Impl {
  Device* owner = nullptr;
  std::string name;
  std::uint32_t bindings = 0, pushBytes = 0;
  std::vector<std::uint32_t> texelWords;
  VkDescriptorSetLayout setLayout = VK_NULL_HANDLE;
  VkPipelineLayout layout = VK_NULL_HANDLE;
  VkPipeline pipeline = VK_NULL_HANDLE;
};

struct Bindings::Impl {
  Device* owner = nullptr;
  VkDescriptorPool pool = VK_NULL_HANDLE;
  VkDescriptorSet set = VK_NULL_HANDLE;
  std::vector<VkBufferView> views;
};

}  // namespace trex::vulkan
