#include "src/app/view/screen_texture.h"

#include <cstring>

namespace trex {

HostBuffer::HostBuffer(const DisplayDevice& device, VkBufferUsageFlags usage)
    : device_(device), usage_(usage) {}

HostBuffer::~HostBuffer() { release(); }

void HostBuffer::release() {
  vkDestroyBuffer(device_.device(), buffer_, nullptr);
  vkFreeMemory(device_.device(), memory_, nullptr);
  buffer_ = VK_NULL_HANDLE;
  memory_ = VK_NULL_HANDLE;
  bytes_ = 0;
}

void HostBuffer::reserve(std::uint64_t bytes) {
  if (bytes <= bytes_) return;
  release();
  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = bytes;
  info.usage = usage_;
  checkVulkan(vkCreateBuffer(device_.device(), &info, nullptr, &buffer_), "vkCreateBuffer");
  VkMemoryRequirements needs;
  vkGetBufferMemoryRequirements(device_.device(), buffer_, &needs);
  VkMemoryAllocateInfo allocate{};
  allocate.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  allocate.allocationSize = needs.size;
  allocate.memoryTypeIndex =
      device_.memoryType(needs.memoryTypeBits, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT |
                                                   VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
  checkVulkan(vkAllocateMemory(device_.device(), &allocate, nullptr, &memory_),
              "memory for the picture");
  checkVulkan(vkBindBufferMemory(device_.device(), buffer_, memory_, 0), "vkBindBufferMemory");
  void* mapped = nullptr;
  checkVulkan(vkMapMemory(device_.device(), memory_, 0, VK_WHOLE_SIZE, 0, &mapped), "vkMapMemory");
  mapped_ = static_cast<std::uint8_t*>(mapped);
  bytes_ = bytes;
}

ScreenTexture::ScreenTexture(const DisplayDevice& device)
    : buffer_(device, VK_BUFFER_USAGE_TRANSFER_SRC_BIT) {}

void ScreenTexture::update(const ScreenImage& image, VkExtent2D window, bool blueFirst) {
  empty_ = image.width == 0 || image.height == 0;
  const bool same =
      image.version == version_ && window.width == window_.width && window.height == window_.height;
  if (empty_ || same) return;
  buffer_.reserve(std::uint64_t{4} * window.width * window.height);
  fitPixels(image, window.width, window.height, blueFirst, buffer_.data());
  version_ = image.version;
  window_ = window;
}

void ScreenTexture::record(VkCommandBuffer commands, VkImage target, VkExtent2D window) const {
  if (empty_) {
    const VkClearColorValue black{{0.06f, 0.06f, 0.07f, 1.0f}};
    const VkImageSubresourceRange range{VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
    vkCmdClearColorImage(commands, target, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, &black, 1, &range);
    return;
  }
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
  region.imageExtent = {window.width, window.height, 1};
  vkCmdCopyBufferToImage(commands, buffer_.buffer(), target, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL,
                         1, &region);
}

void fitPixels(const ScreenImage& image, std::uint32_t width, std::uint32_t height, bool blueFirst,
               std::uint8_t* target) {
  std::vector<std::uint32_t> columns(width);
  for (std::uint32_t x = 0; x < width; ++x) {
    columns[x] = static_cast<std::uint32_t>(std::uint64_t{x} * image.width / width);
  }
  std::vector<std::uint32_t> row(image.width), fitted(width);
  std::uint32_t rowThere = ~0u;
  for (std::uint32_t y = 0; y < height; ++y) {
    const auto from = static_cast<std::uint32_t>(std::uint64_t{y} * image.height / height);
    if (from != rowThere) {
      std::memcpy(row.data(), &image.rgba[std::size_t{4} * from * image.width],
                  std::size_t{4} * image.width);
      for (std::uint32_t x = 0; x < width; ++x) {
        const std::uint32_t c = row[columns[x]];
        fitted[x] = blueFirst ? (c & 0xff00ff00u) | ((c & 0xffu) << 16) | ((c >> 16) & 0xffu) : c;
      }
      rowThere = from;
    }
    std::memcpy(target + std::size_t{4} * y * width, fitted.data(), std::size_t{4} * width);
  }
}

}  // namespace trex
