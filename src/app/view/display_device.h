// The Vulkan instance, device and queue that draw the window; apart from those that trace G-rays.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <string>

struct GLFWwindow;

namespace trex {

/// Throws Error(kMemoryOrDevice) unless the result is VK_SUCCESS; `what` reads like
/// "vkCreateFence".
void checkVulkan(VkResult result, const char* what);

/// Chooses a device that can draw into the window: a discrete one first, a software device last.
/// With TREX_VALIDATION=1 the validation layer is on and its messages go to stderr and are counted.
class DisplayDevice {
 public:
  /// Throws Error(kMemoryOrDevice) if nothing can draw into the window.
  explicit DisplayDevice(GLFWwindow* window);
  ~DisplayDevice();
  DisplayDevice(const DisplayDevice&) = delete;
  DisplayDevice& operator=(const DisplayDevice&) = delete;

  VkInstance instance() const { return instance_; }
  VkPhysicalDevice physical() const { return physical_; }
  VkDevice device() const { return device_; }
  VkQueue queue() const { return queue_; }
  VkSurfaceKHR surface() const { return surface_; }
  std::uint32_t queueFamily() const { return family_; }
  /// The device computes on the host's own cores.
  bool software() const { return software_; }
  const std::string& name() const { return name_; }
  /// Index of a memory type in `bits` that has these properties. Throws Error(kMemoryOrDevice).
  std::uint32_t memoryType(std::uint32_t bits, VkMemoryPropertyFlags properties) const;

 private:
  void choose();
  void createDevice();

  VkInstance instance_ = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkSurfaceKHR surface_ = VK_NULL_HANDLE;
  VkPhysicalDevice physical_ = VK_NULL_HANDLE;
  VkDevice device_ = VK_NULL_HANDLE;
  VkQueue queue_ = VK_NULL_HANDLE;
  std::uint32_t family_ = 0;
  bool software_ = false;
  std::string name_;
};

}  // namespace trex
