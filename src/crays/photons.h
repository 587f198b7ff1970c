// First flights of photons: from a light, through specular chains, to the first surface that can hold
// light. They are C-rays, so direct light and caustics in the cache are sharp [Jensen 1996].
#pragma once

#include <cstdint>
#include <vector>

#include "src/crays/lights.h"
#include "src/crays/ray_scene.h"

namespace trex {

struct LandedPhoton {
  vec3 position, normal;  ///< normal: geometric, unit, on the side the light came from
  vec3 power;             ///< W, as EmittedPhoton
  std::uint32_t index;
};

/// Traces photons first, first + 1, ... first + count - 1; those that land, in the order of their
/// numbers. Deterministic for any number of threads (oneTBB).
std::vector<LandedPhoton> landPhotons(const Scene& scene, const RayScene& rays,
                                      const LightSet& lights, std::uint32_t seed,
                                      std::uint64_t first, std::uint64_t count);

}  // namespace trex
