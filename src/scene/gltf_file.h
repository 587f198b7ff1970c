// glTF: the file itself: its container, its JSON, buffers and images. tinygltf parses all else.
//
// tinygltf refuses a whole file for one buffer or image that is not there, and copies buffers. So
// both lists are taken out of the JSON before it sees them and read here, where they lie.
#pragma once

#include "src/scene/gltf_detail.h"

namespace trex::detail {

/// Parses a .gltf or .glb file that lies in memory into the context, whose path and name are set;
/// `bytes` must live as long as it. Throws Error(kInput) if it is no glTF. Buffers and images that
/// can't be had do no harm until they are used.
void parseGltf(GltfContext& context, std::span<const std::uint8_t> bytes);

/// The bytes of a buffer view. Throws Error(kInput) if they are not there.
std::span<const std::uint8_t> bytesOfView(const GltfContext& context, int number);

/// Makes a view of bytes in a buffer of their own.
void setData(GltfContext& context, tinygltf::BufferView& view, std::vector<std::uint8_t> data);

/// Decodes one of GltfContext::images. Throws Error(kInput).
Image decodeGltfImage(GltfContext& context, int number, bool srgb);

}  // namespace trex::detail
