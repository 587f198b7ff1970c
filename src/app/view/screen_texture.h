// The picture on its way to the window: kept in memory that the device copies from, in the window's
// size and order of bytes. No shader runs over it, which matters where the device is software.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <vector>

#include "src/app/view/display_device.h"
#include "src/viewer/viewer.h"

namespace trex {

/// Memory that both host and device see.
class HostBuffer {
 public:
  HostBuffer(const DisplayDevice& device, VkBufferUsageFlags usage);
  ~HostBuffer();
  HostBuffer(const HostBuffer&) = delete;
  HostBuffer& operator=(const HostBuffer&) = delete;
  /// Makes room for this many bytes; what was in it is lost if it must grow.
  void reserve(std::uint64_t bytes);
  VkBuffer buffer() const { return buffer_; }
  std::uint8_t* data() const { return mapped_; }

 private:
  void release();
  const DisplayDevice& device_;
  VkBufferUsageFlags usage_;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::uint8_t* mapped_ = nullptr;
  std::uint64_t bytes_ = 0;
};

class ScreenTexture {
 public:
  explicit ScreenTexture(const DisplayDevice& device);

  /// Takes the picture over if its version or the window's size has changed, each pixel repeated
  /// as often as fills the window. The device must not be copying.
  void update(const ScreenImage& image, VkExtent2D window, bool blueFirst);
  /// Records the copy into an image in layout TRANSFER_DST; black if there is no picture.
  void record(VkCommandBuffer commands, VkImage target, VkExtent2D window) const;

 private:
  HostBuffer buffer_;
  std::uint64_t version_ = 0;
  VkExtent2D window_{};
  bool empty_ = true;
};

/// Repeats or drops pixels of `image` so that they fill width * height; 4 bytes a pixel, red and
/// blue swapped if `blueFirst`.
void fitPixels(const ScreenImage& image, std::uint32_t width, std::uint32_t height, bool blueFirst,
               std::uint8_t* target);

}  // namespace trex
