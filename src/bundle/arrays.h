// Sections of plain arrays: texels, and the meshes that shine.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "src/bundle/contents.h"

namespace trex::bundle {

/// An image as tiles (FORMAT.md). Throws Error(kFailed) if zstd does.
std::shared_ptr<const std::span<const std::byte>> packImage(const Image& image);

/// The floats of a map as one zstd frame. Throws Error(kFailed) if zstd does.
std::vector<std::byte> packMap(const Image& map);

/// Fills the floats of a map whose sizes are set. Throws Error(kInput) that starts with `where` if
/// the frame does not hold exactly these, or one is not finite.
void unpackMap(std::span<const std::byte> frame, const std::string& where, Image& map);

/// Positions and triangles of the meshes that emit, one after the other.
std::vector<std::byte> packEmitters(const Description& description,
                                    const std::vector<Mesh>& meshes);

/// Fills the arrays of the description's scene. Throws Error(kInput) if the section's size is not
/// theirs, a position is not finite or an index beyond its mesh.
void unpackEmitters(std::span<const std::byte> bytes, const std::string& where,
                    Description& description);

}  // namespace trex::bundle
