// What a scene requires to be rendered, and what is left out because it does not.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/scene/scene.h"

namespace trex::bundle {

struct Requirement {
  std::string name;  ///< "normals", "texture coordinates", ...
  bool required = false;
  std::string reason;            ///< one line for people
  std::uint64_t savedBytes = 0;  ///< not stored because not required; 0 where it can't be said
};

/// Asks a scene whose meshes have their arrays. `voxels`: whether they are wanted at all.
std::vector<Requirement> requirementsOf(const Scene& scene, bool voxels);

}  // namespace trex::bundle
