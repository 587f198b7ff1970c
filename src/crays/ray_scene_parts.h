// Where meshes of the ray scene stand. Not for other folders.
#pragma once

#include "src/crays/ray_scene.h"

namespace trex {

/// Where a mesh of Parts::shared stands: from its space to render space, and the object that it is
/// of; kNone if its clusters know that.
struct SharedPlace {
  dmat4 toRender{1.0};
  int object = kNone;
};
SharedPlace placeOf(const Scene& scene, const RayScene::Parts& parts,
                    const RayScene::Parts::Placed& placed);

}  // namespace trex
