// The images of the window and the pass that draws panels over the picture.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <vector>

#include "src/app/view/display_device.h"

namespace trex {

class Swapchain {
 public:
  explicit Swapchain(const DisplayDevice& device);
  ~Swapchain();
  Swapchain(const Swapchain&) = delete;
  Swapchain& operator=(const Swapchain&) = delete;

  /// Makes images of this size, or of the one that the surface insists on. The device must be
  /// idle. False if the window has no area now.
  bool recreate(std::uint32_t width, std::uint32_t height);

  /// Number of the next image, or -1 if the images no longer fit the window.
  int acquire(VkSemaphore available);
  /// Shows image `index` once its semaphore is signalled. False: the images no longer fit.
  bool present(std::uint32_t index);

  VkExtent2D extent() const { return extent_; }
  bool ready() const { return swapchain_ != VK_NULL_HANDLE; }
  std::uint32_t imageCount() const { return static_cast<std::uint32_t>(images_.size()); }
  VkImage image(std::uint32_t i) const { return images_[i]; }
  VkFramebuffer framebuffer(std::uint32_t i) const { return framebuffers_[i]; }
  VkSemaphore drawn(std::uint32_t i) const { return drawn_[i]; }
  /// Keeps what an image holds (left by a transfer) and leaves it ready to present.
  VkRenderPass pass() const { return pass_; }
  /// Blue comes first in the images' bytes.
  bool blueFirst() const { return format_.format == VK_FORMAT_B8G8R8A8_UNORM; }

 private:
  void chooseFormat();
  void choosePresentMode();
  void createPass();
  void createImages();
  void destroyImages();

  const DisplayDevice& device_;
  VkSurfaceFormatKHR format_{};
  VkPresentModeKHR mode_ = VK_PRESENT_MODE_FIFO_KHR;
  VkSwapchainKHR swapchain_ = VK_NULL_HANDLE;
  VkRenderPass pass_ = VK_NULL_HANDLE;
  VkExtent2D extent_{};
  std::vector<VkImage> images_;
  std::vector<VkImageView> views_;
  std::vector<VkFramebuffer> framebuffers_;
  std::vector<VkSemaphore> drawn_;
};

}  // namespace trex
