#include "src/app/view/display_device.h"

#include <GLFW/glfw3.h>

#include <vector>

#include "src/core/error.h"
#include "src/vulkan/validation.h"

namespace trex {
namespace {

template <typename Function>
Function load(VkInstance instance, const char* name) {
  return reinterpret_cast<Function>(vkGetInstanceProcAddr(instance, name));
}

VkInstance createInstance(bool validation) {
  std::uint32_t count = 0;
  const char** needed = glfwGetRequiredInstanceExtensions(&count);
  if (needed == nullptr) {
    fail(ExitCode::kMemoryOrDevice,
         "no Vulkan driver can draw into a window: install mesa-vulkan-drivers or your GPU's "
         "driver; trex doctor says more");
  }
  std::vector<const char*> extensions(needed, needed + count);
  const VkDebugUtilsMessengerCreateInfoEXT messenger = vulkan::messengerInfo(false);
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.pApplicationName = "trex-view";
  application.apiVersion = VK_API_VERSION_1_1;
  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  info.pApplicationInfo = &application;
  if (validation) {
    extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    info.pNext = &messenger;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &vulkan::kValidationLayer;
  }
  info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  VkInstance instance = VK_NULL_HANDLE;
  const VkResult result = vkCreateInstance(&info, nullptr, &instance);
  if (result == VK_ERROR_LAYER_NOT_PRESENT) {
    vulkan::validationLayerMissing();
  }
  checkVulkan(result, "starting Vulkan for the window");
  return instance;
}

/// First queue family that draws and presents to the surface, or -1.
int drawFamily(VkPhysicalDevice device, VkSurfaceKHR surface) {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  for (std::uint32_t i = 0; i < count; ++i) {
    VkBool32 presents = VK_FALSE;
    vkGetPhysicalDeviceSurfaceSupportKHR(device, i, surface, &presents);
    if (presents == VK_TRUE && (families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT) != 0) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

int rank(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
      return 4;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
      return 3;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
      return 2;
    default:
      return 1;
  }
}

}  // namespace

void checkVulkan(VkResult result, const char* what) {
  if (result == VK_SUCCESS) return;
  fail(ExitCode::kMemoryOrDevice, "drawing the window: {} failed (VkResult {}); see trex doctor",
       what, static_cast<int>(result));
}

DisplayDevice::DisplayDevice(GLFWwindow* window) {
  const bool validation = vulkan::validationWanted();
  instance_ = createInstance(validation);
  if (validation) {
    const VkDebugUtilsMessengerCreateInfoEXT info = vulkan::messengerInfo(false);
    checkVulkan(
        load<PFN_vkCreateDebugUtilsMessengerEXT>(instance_, "vkCreateDebugUtilsMessengerEXT")(
            instance_, &info, nullptr, &messenger_),
        "starting Vulkan validation");
  }
  checkVulkan(glfwCreateWindowSurface(instance_, window, nullptr, &surface_),
              "making the window's surface");
  choose();
  createDevice();
}

DisplayDevice::~DisplayDevice() {
  vkDestroyDevice(device_, nullptr);
  vkDestroySurfaceKHR(instance_, surface_, nullptr);
  if (messenger_ != VK_NULL_HANDLE) {
    load<PFN_vkDestroyDebugUtilsMessengerEXT>(instance_, "vkDestroyDebugUtilsMessengerEXT")(
        instance_, messenger_, nullptr);
  }
  vkDestroyInstance(instance_, nullptr);
}

void DisplayDevice::choose() {
  std::uint32_t count = 0;
  checkVulkan(vkEnumeratePhysicalDevices(instance_, &count, nullptr), "listing devices");
  std::vector<VkPhysicalDevice> devices(count);
  checkVulkan(vkEnumeratePhysicalDevices(instance_, &count, devices.data()), "listing devices");
  int best = 0;
  for (VkPhysicalDevice device : devices) {
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(device, &properties);
    const int family = drawFamily(device, surface_);
    if (family < 0 || rank(properties.deviceType) <= best) continue;
    best = rank(properties.deviceType);
    physical_ = device;
    family_ = static_cast<std::uint32_t>(family);
    name_ = properties.deviceName;
    software_ = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
  }
  if (best == 0) {
    fail(ExitCode::kMemoryOrDevice,
         "no Vulkan device can draw into this window; install mesa-vulkan-drivers (needs no GPU)");
  }
}

void DisplayDevice::createDevice() {
  const float priority = 1.0f;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueFamilyIndex = family_;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  const char* extension = VK_KHR_SWAPCHAIN_EXTENSION_NAME;
  VkDeviceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  info.enabledExtensionCount = 1;
  info.ppEnabledExtensionNames = &extension;
  checkVulkan(vkCreateDevice(physical_, &info, nullptr, &device_), "starting the device");
  vkGetDeviceQueue(device_, family_, 0, &queue_);
}

std::uint32_t DisplayDevice::memoryType(std::uint32_t bits,
                                        VkMemoryPropertyFlags properties) const {
  VkPhysicalDeviceMemoryProperties memory;
  vkGetPhysicalDeviceMemoryProperties(physical_, &memory);
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    const bool fits = (memory.memoryTypes[i].propertyFlags & properties) == properties;
    if (fits && (bits & (1u << i)) != 0) return i;
  }
  fail(ExitCode::kMemoryOrDevice, "drawing the window: {} has no fitting memory", name_);
}

}  // namespace trex
