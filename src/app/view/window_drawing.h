// How a window's frame is drawn: copy the picture, draw the panels over it, present.
#pragma once

#include <vulkan/vulkan.h>

#include "src/app/view/display_device.h"
#include "src/app/view/screen_texture.h"
#include "src/app/view/swapchain.h"
#include "src/app/view/window.h"

namespace trex {

struct Window::Drawing {
 public:
  explicit Drawing(GLFWwindow* window);
  ~Drawing();

  const DisplayDevice& device() const { return device_; }
  void waitIdle();
  /// Gives ImGui what it needs to draw; its context exists.
  void startPanels();
  void present(const ScreenImage& picture, std::uint32_t width, std::uint32_t height);
  void keepNextFrame() { keep_ = true; }
  const ScreenImage& shown() const { return shown_; }

 private:
  void begin();
  void submit(VkSemaphore wait, VkSemaphore signal);
  void waitForFrame();
  void record(std::uint32_t image);
  void recordReadBack(VkImage image);
  void takeReadBack();

  DisplayDevice device_;
  Swapchain swapchain_;
  ScreenTexture picture_;
  HostBuffer readBack_;
  VkDescriptorPool descriptors_ = VK_NULL_HANDLE;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  VkSemaphore available_ = VK_NULL_HANDLE;
  bool pending_ = false;  ///< commands_ may still run
  bool stale_ = true;     ///< the images do not fit the window
  bool keep_ = false;
  ScreenImage shown_;
};

}  // namespace trex
