// The validation layer, as TREX_VALIDATION asks for it: of instances that compute and of those that
// draw. Needs no Vulkan function.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>

namespace trex::vulkan {

inline constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

/// TREX_VALIDATION is set, and not to 0.
bool validationWanted();

/// What an instance's messenger is made from: its messages of this severity go to stderr and are
/// counted by validationMessages() (vulkan.h). Warnings of speed are asked for with `performance`.
VkDebugUtilsMessengerCreateInfoEXT messengerInfo(bool performance);

/// Throws Error(kMemoryOrDevice): the layer is wanted and not there.
[[noreturn]] void validationLayerMissing();

}  // namespace trex::vulkan
