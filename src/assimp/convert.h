// A scene of assimp as binary glTF.
#pragma once

#include <assimp/scene.h>

#include <cstdint>
#include <string>
#include <vector>

namespace trex {

/// Converts it, in metres with y up as far as the scene knows its units; frees meshes on the way.
/// What can't be told in glTF is named. `files` were read for it besides the model. Throws
/// std::bad_alloc, or std::length_error if it is too large for glTF.
std::vector<std::uint8_t> gltfOf(aiScene& scene, std::vector<std::string> files);

}  // namespace trex
