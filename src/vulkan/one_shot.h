// Commands recorded, run and waited for at once: uploads and downloads. Private to src/vulkan.
#pragma once

#include <cstdint>

#include "src/vulkan/device.h"

namespace trex::vulkan {

class OneShot {
 public:
  explicit OneShot(Device& device);
  ~OneShot();
  OneShot(const OneShot&) = delete;
  OneShot& operator=(const OneShot&) = delete;

  void copy(VkBuffer from, std::uint64_t fromOffset, VkBuffer to, std::uint64_t toOffset,
            std::uint64_t bytes);
  void fillZero(VkBuffer buffer);

 private:
  void begin();
  void run();
  void release();

  Device::Impl& d_;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
};

/// Makes all writes before it visible to all that follows, host reads included.
void fullBarrier(const DeviceFunctions& f, VkCommandBuffer commands);
VkCommandPool makeCommandPool(Device::Impl& d);
VkCommandBuffer makeCommandBuffer(Device::Impl& d, VkCommandPool pool);
VkFence makeFence(Device::Impl& d);

}  // namespace trex::vulkan
