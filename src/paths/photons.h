// First flights of photons: from a light, through specular chains, to the first surface that can
// hold light. They are C-rays, so direct light and caustics in the cache are sharp [Jensen 1996].
// On their way they count in voxels wherever they meet a surface, be it a mirror or the hole of a
// leaf: a voxel's light is what comes to all of its faces, over their area.
// C-rays may also carry photons on to the end of their way: voxels know no media, and where the
// device shares the host's cores rays between real surfaces cost less than their way through voxels
// (docs/figures.md).
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "src/crays/lights.h"

namespace trex {

class WalkTracer;

/// Ends of rays of a photon, at most: as many as of a path, so that both see the same of light that
/// is shut in between white walls.
inline constexpr std::uint32_t kPhotonBounces = 256;

struct LandedPhoton {
  vec3 position, normal;  ///< normal: geometric, unit, on the side the light came from
  vec3 power;             ///< W, as EmittedPhoton
  std::uint32_t index;
  std::uint32_t source;  ///< this and the rest as in EmittedPhoton
  vec4 primary;
  float density;
  std::uint32_t bounce;  ///< landings of this photon before where `held`
  std::uint32_t turns;   ///< its turns before, as Scene::maxBounces counts
  /// Whether cached light serves what it met. If not (a metal, a hole, something unlit) it is a
  /// part of what comes to the voxel there, which others share, and no more.
  bool held;
};

/// Traces photons first, first + 1, ... first + count - 1; those that land, in the order of their
/// numbers and of their landings; without `allBounces`, up to the first that is `held`.
/// Deterministic: see WalkTracer::follow(); none if `giveUp` said so. `guides` as in
/// LightSet::emit.
std::optional<std::vector<LandedPhoton>> landPhotons(const Scene& scene, const WalkTracer& walks,
                                                     const LightSet& lights, std::uint32_t seed,
                                                     std::uint64_t first, std::uint64_t count,
                                                     bool allBounces,
                                                     std::span<const EmissionGuide> guides = {},
                                                     const std::function<bool()>& giveUp = {});

/// A photon that landed where light is wanted, as guides learn from it. 28 bytes.
struct PhotonLesson {
  vec4 primary;  ///< this, density and source as in EmittedPhoton
  float density;
  float visits;  ///< ImportanceMap::visits(), above 0
  std::uint32_t source;
};
static_assert(sizeof(PhotonLesson) == 28);

/// What guides can learn of photons that landed, in their order.
std::vector<PhotonLesson> lessonsOf(std::span<const LandedPhoton> landed,
                                    const ImportanceMap& importance,
                                    std::span<const EmissionGuide> guides);

/// Teaches it to them. Lessons of sources without a guide are left out.
void learn(std::span<const PhotonLesson> lessons, std::span<EmissionGuide> guides);

}  // namespace trex
