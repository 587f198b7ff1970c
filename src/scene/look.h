// What a person may change of a scene that is open: camera, materials, lights, environment,
// visibility. A look is a plain value; undo keeps old ones, a file keeps how one differs from the
// scene it belongs to (look_file.h).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "src/scene/scene.h"

namespace trex {

/// Everything on the side that `normal` points to is cut away, for every ray.
struct SectionPlane {
  dvec3 point{0.0};               ///< world, metres
  vec3 normal{1.0f, 0.0f, 0.0f};  ///< unit
  bool operator==(const SectionPlane&) const = default;
};

struct Look {
  Camera camera;
  float exposure = 0.0f;            ///< stops, of the screen alone
  std::vector<Material> materials;  ///< as many as the scene has; textures can't change
  std::vector<Light> lights;        ///< of the scene and added ones
  Environment environment;
  std::vector<std::uint32_t> hidden;  ///< objects that no ray sees; ascending, each once
  std::optional<SectionPlane> section;
  bool operator==(const Look&) const;
};

/// The look of a scene as it was imported, seen through its first camera.
Look lookOf(const Scene& scene);

/// What differs between two looks of one scene.
struct LookChanges {
  bool camera = false, exposure = false, lights = false, environment = false, visibility = false;
  std::vector<std::uint32_t> materials;  ///< that differ
  bool any() const {
    return camera || exposure || lights || environment || visibility || !materials.empty();
  }
};
LookChanges compareLooks(const Look& before, const Look& after);

/// What each class of change makes invalid. Camera moves keep photons and voxels.
struct Invalidation {
  bool frame = false;        ///< samples of the picture
  bool lights = false;       ///< the set of lights
  bool flux = false;         ///< photons
  bool voxelValues = false;  ///< albedo and emission of voxels
  bool voxelShape = false;   ///< which voxels there are
};
Invalidation invalidatedBy(const Look& before, const Look& after);

/// Light passes a surface of this material nearly unscattered (smooth glass, faint coverage):
/// voxels leave it out.
bool passesLight(const Material& material);

}  // namespace trex
