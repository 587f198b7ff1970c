#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>

#include "src/core/error.h"
#include "src/vulkan/device.h"
#include "src/vulkan/one_shot.h"

namespace trex::vulkan {

namespace {

constexpr std::uint64_t kStagingBytes = 8u << 20, kLeastStagingBytes = 64u << 10;

/// Size of a buffer to copy `bytes` through: what is allowed may be almost used up.
std::uint64_t stagingBytes(const Device& device, std::uint64_t bytes) {
  const std::uint64_t left =
      device.maxBytes() - std::min(device.maxBytes(), device.allocatedBytes());
  return std::min({kStagingBytes, bytes, std::max(left / 2, kLeastStagingBytes)});
}

// Sizes are told before anything is allocated, so that the message can say what to do.
void requireRoom(const Device& device, const std::string& name, std::uint64_t bytes) {
  const DeviceInfo& info = device.info();
  if (bytes > info.maxStorageBufferRange || bytes > info.maxAllocationBytes) {
    fail(ExitCode::kMemoryOrDevice,
         "{} need {} bytes but one storage buffer of {} holds at most {}: lower the voxel depth, "
         "choose another `--device N`, or use `--device none`",
         name, bytes, info.name, std::min(info.maxStorageBufferRange, info.maxAllocationBytes));
  }
  const std::uint64_t left =
      device.maxBytes() - std::min(device.maxBytes(), device.allocatedBytes());
  if (bytes > left) {
    fail(ExitCode::kMemoryOrDevice,
         "{} need {} bytes but only {} of the {} bytes allowed on {} are left: raise "
         "`--max-gpu-memory`, lower the voxel depth, or use `--device none`",
         name, bytes, left, device.maxBytes(), info.name);
  }
}

int findType(const VkPhysicalDeviceMemoryProperties& memory, std::uint32_t allowed,
             VkMemoryPropertyFlags wanted) {
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    if ((allowed >> i & 1u) != 0 && (memory.memoryTypes[i].propertyFlags & wanted) == wanted) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

// The best memory type for a place: first of a list of wishes that exists.
std::uint32_t chooseType(const Device::Impl& d, std::uint32_t allowed, Place place) {
  constexpr VkMemoryPropertyFlags kLocal = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
  constexpr VkMemoryPropertyFlags kVisible =
      VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  const std::array<VkMemoryPropertyFlags, 3> device = {
      d.info.mappedMemory ? kLocal | kVisible : kLocal, kLocal, 0};
  const std::array<VkMemoryPropertyFlags, 3> host = {kVisible | VK_MEMORY_PROPERTY_HOST_CACHED_BIT,
                                                     kVisible, kVisible};
  for (const VkMemoryPropertyFlags wanted : place == Place::kDevice ? device : host) {
    const int type = findType(d.memory, allowed, wanted);
    if (type >= 0) return static_cast<std::uint32_t>(type);
  }
  fail(ExitCode::kMemoryOrDevice, "{} offers no memory for buffers: use `--device none`",
       d.info.name);
}

}  // namespace

Buffer::Buffer(Device& device, const std::string& name, std::uint64_t bytes, Place place)
    : impl_(std::make_unique<Impl>()) {
  Device::Impl& d = device.impl();
  Impl& b = *impl_;
  b.owner = &device;
  b.name = name;
  b.bytes = std::max<std::uint64_t>(bytes, 16);
  requireRoom(device, name, b.bytes);

  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = b.bytes;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT |
               VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  d.check(d.f.vkCreateBuffer(d.device, &info, nullptr, &b.buffer), "making a buffer for " + name);
  try {
    VkMemoryRequirements needs{};
    d.f.vkGetBufferMemoryRequirements(d.device, b.buffer, &needs);
    VkMemoryAllocateInfo allocate{};
    allocate.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
    allocate.allocationSize = needs.size;
    allocate.memoryTypeIndex = chooseType(d, needs.memoryTypeBits, place);
    const bool fails = Device::Impl::failsNow(d.allocations, d.options.failAllocation);
    d.check(fails ? VK_ERROR_OUT_OF_DEVICE_MEMORY
                  : d.f.vkAllocateMemory(d.device, &allocate, nullptr, &b.memory),
            fmt::format("allocating {} bytes for {}", needs.size, name));
    b.allocated = needs.size;
    d.allocatedBytes += b.allocated;
    d.check(d.f.vkBindBufferMemory(d.device, b.buffer, b.memory, 0), "binding memory of " + name);
    const VkMemoryPropertyFlags flags =
        d.memory.memoryTypes[allocate.memoryTypeIndex].propertyFlags;
    const bool visible = (flags & VK_MEMORY_PROPERTY_HOST_COHERENT_BIT) != 0;
    if (visible && (place == Place::kHost || d.info.mappedMemory)) {
      void* address = nullptr;
      d.check(d.f.vkMapMemory(d.device, b.memory, 0, VK_WHOLE_SIZE, 0, &address),
              "mapping " + name);
      b.mapped = static_cast<std::byte*>(address);
    }
  } catch (...) {
    release();
    throw;
  }
}

void Buffer::release() {
  Device::Impl& d = impl_->owner->impl();
  d.f.vkDestroyBuffer(d.device, impl_->buffer, nullptr);
  d.f.vkFreeMemory(d.device, impl_->memory, nullptr);
  d.allocatedBytes -= impl_->allocated;
}

Buffer::~Buffer() { release(); }

std::uint64_t Buffer::size() const { return impl_->bytes; }
std::byte* Buffer::mapped() const { return impl_->mapped; }

void Buffer::upload(std::span<const std::byte> bytes, std::uint64_t offset) {
  assert(offset <= size() && bytes.size() <= size() - offset);
  if (bytes.empty()) return;
  if (mapped() != nullptr) {
    std::memcpy(mapped() + offset, bytes.data(), bytes.size());
    return;
  }
  Buffer staging(*impl_->owner, "staging", stagingBytes(*impl_->owner, bytes.size()), Place::kHost);
  OneShot shot(*impl_->owner);
  for (std::size_t done = 0; done < bytes.size();) {
    const std::size_t part = std::min<std::size_t>(staging.size(), bytes.size() - done);
    std::memcpy(staging.mapped(), bytes.data() + done, part);
    shot.copy(staging.impl().buffer, 0, impl_->buffer, offset + done, part);
    done += part;
  }
}

void Buffer::download(std::span<std::byte> bytes, std::uint64_t offset) const {
  assert(offset <= size() && bytes.size() <= size() - offset);
  if (bytes.empty()) return;
  if (mapped() != nullptr) {
    std::memcpy(bytes.data(), mapped() + offset, bytes.size());
    return;
  }
  Buffer staging(*impl_->owner, "staging", stagingBytes(*impl_->owner, bytes.size()), Place::kHost);
  OneShot shot(*impl_->owner);
  for (std::size_t done = 0; done < bytes.size();) {
    const std::size_t part = std::min<std::size_t>(staging.size(), bytes.size() - done);
    shot.copy(impl_->buffer, offset + done, staging.impl().buffer, 0, part);
    std::memcpy(bytes.data() + done, staging.mapped(), part);
    done += part;
  }
}

void Buffer::clear() {
  if (mapped() != nullptr) {
    std::memset(mapped(), 0, size());
    return;
  }
  OneShot(*impl_->owner).fillZero(impl_->buffer);
}

}  // namespace trex::vulkan
