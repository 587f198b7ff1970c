#include "src/vulkan/device.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "src/core/error.h"

namespace trex::vulkan {

namespace {

int rank(const DeviceInfo& info) {
  if (info.type == "discrete") return 4;
  if (info.type == "integrated") return 3;
  if (info.type == "virtual") return 2;
  return info.type == "cpu" ? 1 : 0;
}

DeviceInfo choose(const std::vector<DeviceInfo>& list, int index) {
  if (list.empty()) {
    fail(ExitCode::kMemoryOrDevice,
         "no Vulkan device was found: install mesa-vulkan-drivers (lavapipe needs no GPU), or use "
         "`--device none`");
  }
  if (index >= static_cast<int>(list.size()) || index < -1) {
    fail(ExitCode::kMemoryOrDevice,
         "there is no Vulkan device {} (devices are 0 to {}): see `trex doctor`, or use "
         "`--device none`",
         index, list.size() - 1);
  }
  if (index >= 0) {
    const DeviceInfo& info = list[static_cast<std::size_t>(index)];
    if (!info.unusable.empty()) {
      fail(ExitCode::kMemoryOrDevice,
           "Vulkan device {} ({}) cannot be used: {}; choose another `--device N` or "
           "`--device none`",
           index, info.name, info.unusable);
    }
    return info;
  }
  const DeviceInfo* best = nullptr;
  for (const DeviceInfo& info : list) {
    if (info.unusable.empty() && (best == nullptr || rank(info) > rank(*best))) best = &info;
  }
  if (best == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "no Vulkan device can be used ({}: {}): use `--device none`",
         list[0].name, list[0].unusable);
  }
  return *best;
}

}  // namespace

std::uint64_t Device::Impl::maxBytes() const {
  return options.maxBytes > 0 ? std::min(options.maxBytes, info.heapBytes) : info.heapBytes;
}

void Device::Impl::check(VkResult result, const std::string& what) {
  if (result == VK_SUCCESS) return;
  lost = lost || result == VK_ERROR_DEVICE_LOST;
  fail(ExitCode::kMemoryOrDevice,
       "{} on {}: {} (VkResult {}); {} MiB of {} MiB are in use; try a smaller `--max-gpu-memory`, "
       "another `--device N`, or `--device none`",
       what, info.name, resultText(result), static_cast<int>(result), allocatedBytes >> 20,
       maxBytes() >> 20);
}

Device::Impl::~Impl() {
  if (device == VK_NULL_HANDLE) return;
  f.vkDeviceWaitIdle(device);
  f.vkDestroyDevice(device, nullptr);
}

Device::Device(const DeviceOptions& options) : impl_(std::make_unique<Impl>()) {
  Impl& d = *impl_;
  d.options = options;
  if (const char* n = std::getenv("TREX_FAIL_SUBMIT")) {
    d.options.failSubmit = std::strtoull(n, nullptr, 10);
  }
  d.instance = Instance::get();
  d.times.instance = d.instance->seconds();
  const auto start = std::chrono::steady_clock::now();

  const std::vector<VkPhysicalDevice> physical = d.instance->physicalDevices();
  const InstanceFunctions& f = d.instance->functions();
  std::vector<DeviceInfo> list;
  for (const VkPhysicalDevice p : physical) {
    list.push_back(describe(f, p, static_cast<int>(list.size())));
  }
  d.info = choose(list, options.index);
  d.physical = physical[static_cast<std::size_t>(d.info.index)];
  d.family = static_cast<std::uint32_t>(computeFamily(f, d.physical));
  if (options.maxStorageBufferRange > 0) {
    d.info.maxStorageBufferRange =
        std::min(d.info.maxStorageBufferRange, options.maxStorageBufferRange);
  }
  if (options.forceStaging) d.info.mappedMemory = false;
  f.vkGetPhysicalDeviceMemoryProperties(d.physical, &d.memory);

  const float priority = 1.0f;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueFamilyIndex = d.family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  VkDeviceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  d.check(f.vkCreateDevice(d.physical, &info, nullptr, &d.device), "starting the device");
  d.f = loadDeviceFunctions(f, d.device);
  d.f.vkGetDeviceQueue(d.device, d.family, 0, &d.queue);
  d.times.device = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Device::~Device() = default;

const DeviceInfo& Device::info() const { return impl_->info; }
std::uint64_t Device::allocatedBytes() const { return impl_->allocatedBytes; }
std::uint64_t Device::maxBytes() const { return impl_->maxBytes(); }
StartTimes Device::startTimes() const { return impl_->times; }
void Device::waitIdle() {
  impl_->check(impl_->f.vkDeviceWaitIdle(impl_->device), "waiting for the device");
}

}  // namespace trex::vulkan
