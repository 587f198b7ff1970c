// Decoding image files (src/images).
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "src/scene/scene.h"

namespace trex::detail {

/// Largest number of texels of one image; its bytes are allocated from the header.
inline constexpr std::int64_t kMaxTexels = std::int64_t(1) << 28;

/// Reads a whole file. Throws Error(kInput) with `what` in front if it can't be read, is a folder
/// or is larger than `limit` bytes.
std::vector<std::uint8_t> readWholeFile(const std::filesystem::path& path, const std::string& what,
                                        std::uint64_t limit = std::uint64_t(1) << 31);

/// Decodes a PNG, JPEG, ... held in memory. Values of 8 and 16 bits stay as they are (alpha not
/// premultiplied), others become floats. What is deeper than 8 bits is sRGB if `srgb`, unless its
/// format is linear anyway. `textures`: those of its scene, whose memory it must fit in; may be
/// null. Throws Error(kInput), or Error(kMemoryOrDevice) if it does not fit, that starts with
/// `name`. Thread safe: one image is decoded at a time.
Image decodeImage(std::span<const std::uint8_t> file, const std::string& name, bool srgb,
                  const TextureCache* textures);

/// Reads a file on disk as light: three floats a texel of linear Rec. 709, finite and not negative;
/// for environments. Whole numbers are decoded as sRGB, the primaries that an .exr names are
/// converted, infinity is the largest half. Of several parts or layers it takes the first R, G, B
/// that belong to no layer, or else those of a layer `Combined` or `beauty`, or else the first
/// layer's. `maxWidth` limits both sides. Says what it changes. Throws as decodeImage() does.
Image readFloatImage(const std::filesystem::path& path, int maxWidth);

}  // namespace trex::detail
