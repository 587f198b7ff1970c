// The process's Vulkan instance. Private to src/vulkan.
#pragma once

#include <memory>
#include <vector>

#include "src/vulkan/functions.h"
#include "src/vulkan/vulkan.h"

namespace trex::vulkan {

/// Shared by all devices while any of them lives; destroyed with the last.
class Instance {
 public:
  static std::shared_ptr<Instance> get();
  Instance();
  ~Instance();
  Instance(const Instance&) = delete;
  Instance& operator=(const Instance&) = delete;

  const InstanceFunctions& functions() const { return functions_; }
  double seconds() const { return seconds_; }  ///< time its creation took
  std::vector<VkPhysicalDevice> physicalDevices() const;

 private:
  VkInstance instance_ = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  InstanceFunctions functions_;
  double seconds_ = 0.0;
};

/// What listDevices() tells of one device.
DeviceInfo describe(const InstanceFunctions& f, VkPhysicalDevice device, int index);
/// First queue family with compute (one without graphics is preferred), or -1.
int computeFamily(const InstanceFunctions& f, VkPhysicalDevice device);

}  // namespace trex::vulkan
