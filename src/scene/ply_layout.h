// Where a binary PLY file, or one that was made such, keeps what is streamed of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "src/scene/growing_array.h"
#include "src/scene/scene.h"

namespace trex::detail {

struct PlyLayout {
  std::uint64_t vertices = 0, faces = 0;
  std::size_t vertexStart = 0, faceStart = 0, stride = 0;
  // Bytes from the start of a vertex.
  std::size_t place[3] = {}, normal[3] = {}, color[4] = {};
  bool normals = false, colors = false, alpha = false;
  bool wide = false;           ///< coordinates are doubles, not floats
  std::size_t countBytes = 1;  ///< of the number of a face's corners: a byte, or a u32
  bool cloud = false;          ///< of points, without faces
};

/// Makes a file of text, of the other byte order, or of numbers of other sizes one with a layout,
/// in temporary memory (GrowingArray). False, and nothing is done, if it has more than vertices and
/// faces with positions, normals and colours of vertices; with `clouds` it may have no faces.
/// Throws Error(kInput).
bool convertPly(const std::filesystem::path& path, bool clouds, Scene& scene, PlyLayout& layout,
                GrowingArray<std::uint8_t>& out);

}  // namespace trex::detail
