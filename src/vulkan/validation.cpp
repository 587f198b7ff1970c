#include "src/vulkan/validation.h"

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "src/core/error.h"
#include "src/vulkan/vulkan.h"

namespace trex::vulkan {
namespace {

std::atomic<std::uint64_t> messageCount{0};

VKAPI_ATTR VkBool32 VKAPI_CALL onMessage(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                         VkDebugUtilsMessageTypeFlagsEXT,
                                         const VkDebugUtilsMessengerCallbackDataEXT* data, void*) {
  messageCount.fetch_add(1, std::memory_order_relaxed);
  std::fprintf(stderr, "trex: validation: %s\n", data->pMessage);
  return VK_FALSE;
}

}  // namespace

bool validationWanted() {
  const char* value = std::getenv("TREX_VALIDATION");
  const std::string_view text = value == nullptr ? "" : value;
  return !text.empty() && text != "0";
}

VkDebugUtilsMessengerCreateInfoEXT messengerInfo(bool performance) {
  VkDebugUtilsMessengerCreateInfoEXT info{};
  info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
  info.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                         VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  if (performance) info.messageType |= VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
  info.pfnUserCallback = onMessage;
  return info;
}

void validationLayerMissing() {
  fail(ExitCode::kMemoryOrDevice,
       "TREX_VALIDATION is set but {} is not installed: install vulkan-validationlayers or unset "
       "it",
       kValidationLayer);
}

std::uint64_t validationMessages() { return messageCount.load(); }

}  // namespace trex::vulkan
