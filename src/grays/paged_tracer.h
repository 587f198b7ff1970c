// The tracer of trees that do not fit on the device. Private to src/grays.
#pragma once

#include <memory>
#include <span>

#include "src/grays/grays.h"
#include "src/vulkan/vulkan.h"

namespace trex {

/// Photons and light on the host, which has all of the tree; cones on the device (paged_gather.h).
/// Throws Error(kMemoryOrDevice) that names the least bytes if the device is too small for that.
/// The tree must not be empty.
std::unique_ptr<GRayTracer> makePagedTracer(const asvo::Tree& tree,
                                            std::span<const shaderio::PhotonMaterial> materials,
                                            std::unique_ptr<vulkan::Device> device,
                                            bool storageBuffers, std::uint32_t pageBits);

}  // namespace trex
