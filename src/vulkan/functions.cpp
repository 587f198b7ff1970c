#include "src/vulkan/functions.h"

#include <dlfcn.h>

#include "src/core/error.h"

namespace trex::vulkan {

namespace {

template <typename Function>
void take(Function& function, PFN_vkVoidFunction address, const char* name) {
  function = reinterpret_cast<Function>(address);
  if (function == nullptr) {
    fail(ExitCode::kMemoryOrDevice, "the Vulkan driver has no {}: update it or use `--device none`",
         name);
  }
}

GlobalFunctions openLoader() {
  void* library = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    fail(ExitCode::kMemoryOrDevice,
         "Vulkan is not installed (libvulkan.so.1: {}): install libvulkan1 and a driver such as "
         "mesa-vulkan-drivers, or use `--device none`",
         dlerror());
  }
  GlobalFunctions f;
  f.vkGetInstanceProcAddr =
      reinterpret_cast<PFN_vkGetInstanceProcAddr>(dlsym(library, "vkGetInstanceProcAddr"));
  if (f.vkGetInstanceProcAddr == nullptr) {
    fail(ExitCode::kMemoryOrDevice,
         "libvulkan.so.1 is not a Vulkan loader: reinstall libvulkan1 or use `--device none`");
  }
#define TREX_VK_TAKE(name) take(f.name, f.vkGetInstanceProcAddr(nullptr, #name), #name);
  TREX_VK_GLOBAL(TREX_VK_TAKE)
#undef TREX_VK_TAKE
  return f;
}

}  // namespace

const GlobalFunctions& globalFunctions() {
  static const GlobalFunctions functions = openLoader();
  return functions;
}

InstanceFunctions loadInstanceFunctions(VkInstance instance) {
  InstanceFunctions f;
  const auto get = globalFunctions().vkGetInstanceProcAddr;
#define TREX_VK_TAKE(name) take(f.name, get(instance, #name), #name);
  TREX_VK_INSTANCE(TREX_VK_TAKE)
#undef TREX_VK_TAKE
  f.vkCreateDebugUtilsMessengerEXT = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
      get(instance, "vkCreateDebugUtilsMessengerEXT"));
  f.vkDestroyDebugUtilsMessengerEXT = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
      get(instance, "vkDestroyDebugUtilsMessengerEXT"));
  return f;
}

DeviceFunctions loadDeviceFunctions(const InstanceFunctions& instance, VkDevice device) {
  DeviceFunctions f;
#define TREX_VK_TAKE(name) take(f.name, instance.vkGetDeviceProcAddr(device, #name), #name);
  TREX_VK_DEVICE(TREX_VK_TAKE)
#undef TREX_VK_TAKE
  return f;
}

const char* resultText(VkResult result) {
  switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY:
      return "out of host memory";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
      return "out of device memory";
    case VK_ERROR_DEVICE_LOST:
      return "the device was lost (crashed, reset or timed out)";
    case VK_ERROR_INITIALIZATION_FAILED:
      return "initialisation failed";
    case VK_ERROR_LAYER_NOT_PRESENT:
      return "layer not present";
    case VK_ERROR_EXTENSION_NOT_PRESENT:
      return "extension not present";
    case VK_ERROR_FEATURE_NOT_PRESENT:
      return "feature not present";
    case VK_ERROR_INCOMPATIBLE_DRIVER:
      return "incompatible driver";
    case VK_ERROR_TOO_MANY_OBJECTS:
      return "too many objects";
    case VK_TIMEOUT:
      return "timed out";
    default:
      return "unexpected result";
  }
}

void check(VkResult result, const char* what) {
  if (result == VK_SUCCESS) return;
  fail(ExitCode::kMemoryOrDevice,
       "{} failed: {} (VkResult {}); try a smaller `--max-gpu-memory`, another `--device N`, or "
       "`--device none`",
       what, resultText(result), static_cast<int>(result));
}

}  // namespace trex::vulkan
