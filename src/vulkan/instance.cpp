#include "src/vulkan/instance.h"

#include <array>
#include <chrono>
#include <cstring>
#include <mutex>

#include "src/core/error.h"
#include "src/vulkan/validation.h"

namespace trex::vulkan {

namespace {

void requireValidationLayer() {
  std::uint32_t count = 0;
  const GlobalFunctions& f = globalFunctions();
  check(f.vkEnumerateInstanceLayerProperties(&count, nullptr), "listing Vulkan layers");
  std::vector<VkLayerProperties> layers(count);
  check(f.vkEnumerateInstanceLayerProperties(&count, layers.data()), "listing Vulkan layers");
  for (const auto& layer : layers) {
    if (std::strcmp(layer.layerName, kValidationLayer) == 0) return;
  }
  validationLayerMissing();
}

VkInstance createInstance(bool validation) {
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.pApplicationName = "trex";
  application.apiVersion = VK_API_VERSION_1_2;

  const VkDebugUtilsMessengerCreateInfoEXT messenger = messengerInfo(true);
  const VkValidationFeatureEnableEXT enable =
      VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
  VkValidationFeaturesEXT features{};
  features.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
  features.pNext = &messenger;
  features.enabledValidationFeatureCount = 1;
  features.pEnabledValidationFeatures = &enable;

  const std::array extensions = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME,
                                 VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME};
  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  info.pApplicationInfo = &application;
  if (validation) {
    info.pNext = &features;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &kValidationLayer;
    info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
    info.ppEnabledExtensionNames = extensions.data();
  }
  VkInstance instance = VK_NULL_HANDLE;
  const VkResult result = globalFunctions().vkCreateInstance(&info, nullptr, &instance);
  if (result == VK_ERROR_INCOMPATIBLE_DRIVER) {
    fail(ExitCode::kMemoryOrDevice,
         "no Vulkan driver was found: install mesa-vulkan-drivers (lavapipe needs no GPU) or your "
         "GPU's driver, or use `--device none`");
  }
  check(result, "starting Vulkan");
  return instance;
}

}  // namespace

DriversAhead::DriversAhead()
    : loading_([this] {
        try {
          instance_ = Instance::get();
        } catch (const Error&) {  // the Device will tell
        }
      }) {}

std::shared_ptr<Instance> Instance::get() {
  static std::mutex mutex;
  static std::weak_ptr<Instance> shared;
  const std::lock_guard lock(mutex);
  std::shared_ptr<Instance> instance = shared.lock();
  if (!instance) {
    instance = std::make_shared<Instance>();
    shared = instance;
  }
  return instance;
}

Instance::Instance() {
  const auto start = std::chrono::steady_clock::now();
  const bool validation = validationWanted();
  if (validation) requireValidationLayer();
  instance_ = createInstance(validation);
  functions_ = loadInstanceFunctions(instance_);
  if (validation) {
    const VkDebugUtilsMessengerCreateInfoEXT info = messengerInfo(true);
    check(functions_.vkCreateDebugUtilsMessengerEXT(instance_, &info, nullptr, &messenger_),
          "starting Vulkan validation");
  }
  seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Instance::~Instance() {
  if (messenger_ != VK_NULL_HANDLE) {
    functions_.vkDestroyDebugUtilsMessengerEXT(instance_, messenger_, nullptr);
  }
  functions_.vkDestroyInstance(instance_, nullptr);
}

std::vector<VkPhysicalDevice> Instance::physicalDevices() const {
  std::uint32_t count = 0;
  VkResult result = functions_.vkEnumeratePhysicalDevices(instance_, &count, nullptr);
  // A driver whose hardware is missing says so here: the same as no device.
  if (result == VK_ERROR_INITIALIZATION_FAILED) return {};
  check(result, "listing Vulkan devices");
  std::vector<VkPhysicalDevice> devices(count);
  check(functions_.vkEnumeratePhysicalDevices(instance_, &count, devices.data()),
        "listing Vulkan devices");
  return devices;
}

}  // namespace trex::vulkan
