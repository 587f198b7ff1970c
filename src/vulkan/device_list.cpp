#include <algorithm>

#include "src/core/error.h"
#include "src/vulkan/instance.h"

namespace trex::vulkan {

namespace {

std::string versionText(std::uint32_t version) {
  return fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version),
                     VK_API_VERSION_PATCH(version));
}

const char* typeText(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
      return "discrete";
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
      return "integrated";
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
      return "virtual";
    case VK_PHYSICAL_DEVICE_TYPE_CPU:
      return "cpu";
    default:
      return "other";
  }
}

void describeMemory(const InstanceFunctions& f, VkPhysicalDevice device, DeviceInfo& info) {
  VkPhysicalDeviceMemoryProperties memory{};
  f.vkGetPhysicalDeviceMemoryProperties(device, &memory);
  std::uint32_t largest = 0;
  for (std::uint32_t i = 0; i < memory.memoryHeapCount; ++i) {
    const VkMemoryHeap& heap = memory.memoryHeaps[i];
    if ((heap.flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) != 0 && heap.size > info.heapBytes) {
      info.heapBytes = heap.size;
      largest = i;
    }
  }
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    const VkMemoryType& type = memory.memoryTypes[i];
    const VkMemoryPropertyFlags wanted =
        VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    if (type.heapIndex == largest && (type.propertyFlags & wanted) == wanted) {
      info.mappedMemory = true;
    }
  }
}

// Only a device that says it speaks 1.2 may be asked through the 1.2 structures.
void describe12(const InstanceFunctions& f, VkPhysicalDevice device, DeviceInfo& info) {
  VkPhysicalDeviceVulkan11Properties properties11{};
  properties11.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES;
  VkPhysicalDeviceVulkan12Properties properties12{};
  properties12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES;
  properties12.pNext = &properties11;
  VkPhysicalDeviceProperties2 properties{};
  properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
  properties.pNext = &properties12;
  f.vkGetPhysicalDeviceProperties2(device, &properties);
  info.driver = fmt::format("{} {}", properties12.driverName, properties12.driverInfo);
  info.subgroupSize = properties11.subgroupSize;
  info.maxAllocationBytes = properties11.maxMemoryAllocationSize;

  VkPhysicalDeviceVulkan12Features features12{};
  features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  VkPhysicalDeviceFeatures2 features{};
  features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  features.pNext = &features12;
  f.vkGetPhysicalDeviceFeatures2(device, &features);
  info.int64 = features.features.shaderInt64 != 0;
  info.sparse = features.features.sparseBinding != 0;
  info.int64Atomics = features12.shaderBufferInt64Atomics != 0;
}

}  // namespace

int computeFamily(const InstanceFunctions& f, VkPhysicalDevice device) {
  std::uint32_t count = 0;
  f.vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  f.vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  int best = -1;
  for (std::uint32_t i = 0; i < count; ++i) {
    const VkQueueFlags flags = families[i].queueFlags;
    if ((flags & VK_QUEUE_COMPUTE_BIT) == 0) continue;
    if (best < 0) best = static_cast<int>(i);
    if ((flags & VK_QUEUE_GRAPHICS_BIT) == 0) return static_cast<int>(i);
  }
  return best;
}

DeviceInfo describe(const InstanceFunctions& f, VkPhysicalDevice device, int index) {
  VkPhysicalDeviceProperties properties{};
  f.vkGetPhysicalDeviceProperties(device, &properties);
  const VkPhysicalDeviceLimits& limits = properties.limits;
  DeviceInfo info;
  info.index = index;
  info.name = properties.deviceName;
  info.type = typeText(properties.deviceType);
  info.apiVersion = versionText(properties.apiVersion);
  info.sharesHostCores = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
  info.maxStorageBufferRange = limits.maxStorageBufferRange;
  info.maxTexelBufferElements = limits.maxTexelBufferElements;
  info.maxWorkgroupInvocations = limits.maxComputeWorkGroupInvocations;
  info.maxWorkgroupCount = limits.maxComputeWorkGroupCount[0];
  info.sharedMemoryBytes = limits.maxComputeSharedMemorySize;
  describeMemory(f, device, info);
  if (properties.apiVersion < VK_API_VERSION_1_2) {
    info.unusable = "it supports Vulkan " + info.apiVersion + ", 1.2 is needed";
  } else {
    describe12(f, device, info);
    if (computeFamily(f, device) < 0) info.unusable = "it has no compute queue";
  }
  return info;
}

std::string loaderVersion() {
  std::uint32_t version = 0;
  check(globalFunctions().vkEnumerateInstanceVersion(&version), "asking for Vulkan's version");
  return versionText(version);
}

std::vector<DeviceInfo> listDevices() {
  const std::shared_ptr<Instance> instance = Instance::get();
  std::vector<DeviceInfo> list;
  for (const VkPhysicalDevice device : instance->physicalDevices()) {
    list.push_back(describe(instance->functions(), device, static_cast<int>(list.size())));
  }
  return list;
}

}  // namespace trex::vulkan
