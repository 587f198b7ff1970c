// Sections of plain arrays: texels, and the meshes that shine.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "src/bundle/contents.h"

namespace trex::bundle {

/// Texels as one zstd frame. Throws Error(kFailed) if zstd does.
std::vector<std::byte> packTexels(const Image& image);

/// Fills the texels of an image whose sizes are set. Throws Error(kInput) that starts with `where`
/// if the frame does not hold exactly these, or a float is not finite.
void unpackTexels(std::span<const std::byte> frame, bool isFloat, const std::string& where,
                  Image& image);

std::uint64_t texelBytes(const Image& image, bool isFloat);

/// Positions and triangles of the meshes that emit, one after the other.
std::vector<std::byte> packEmitters(const Description& description,
                                    const std::vector<Mesh>& meshes);

/// Fills the arrays of the description's scene. Throws Error(kInput) if the section's size is not
/// theirs, a position is not finite or an index beyond its mesh.
void unpackEmitters(std::span<const std::byte> bytes, const std::string& where,
                    Description& description);

}  // namespace trex::bundle
