// What a bundle says of a scene, before it is written.
#pragma once

#include "src/bundle/bundle.h"

namespace trex::bundle {

/// What was made of the scene.
struct MadeParts {
  dvec3 renderOrigin{0.0};
  std::uint32_t sharedMeshes = 0;
  std::vector<RayScene::Parts::Placed> placed;
  bool voxels = false;
};

/// The description of a scene whose meshes have arrays at least where they emit.
Description describe(const Scene& scene, const MadeParts& parts, const BakeFacts& facts);

}  // namespace trex::bundle
