// Where meshes of the ray scene stand. Not for other folders.
#pragma once

#include "src/crays/ray_scene.h"

namespace trex {

/// From a shared mesh's space to render space.
dmat4 sharedToRender(const Scene& scene, const Instance& instance, const hccm::Mesh& mesh,
                     const dvec3& renderOrigin);

}  // namespace trex
