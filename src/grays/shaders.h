// The compiled shaders, embedded in the program. Private to src/grays.
#pragma once

#include <cstdint>
#include <span>

namespace trex {

/// `texels`: the tree is read through texel buffers, else through storage buffers (shaders/tree.h).
std::span<const std::uint32_t> gatherShader(bool texels);
/// Of a tree in pages.
std::span<const std::uint32_t> pagedGatherShader(bool texels);
std::span<const std::uint32_t> photonShader(bool texels);

}  // namespace trex
