// The photon map of [Jensen 1996], against which `trex bench baselines` measures: photons at the
// places where they landed, and irradiance from the nearest of them.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "src/crays/light_cache.h"
#include "src/paths/photons.h"

namespace trex {

/// Immutable, so thread safe.
class PhotonMap final : public CachedLight {
 public:
  /// `emitted`: photons that were shot for those that landed. `nearest`: how many of them an
  /// irradiance is taken of, at least 1.
  PhotonMap(std::span<const LandedPhoton> landed, std::uint64_t emitted, std::size_t nearest);
  ~PhotonMap() override;

  float leafSize() const override { return 0.0f; }
  /// The power of the nearest photons that came from this side (their surface within 60 degrees of
  /// `normal`), over the disk that holds them. False where there are none.
  bool irradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                  vec3& out) const override;

  float shareOfTurns(const vec3& position, std::uint32_t turns) const override {
    return turns_.at(position, turns);
  }

  std::size_t photons() const;
  std::size_t bytes() const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
  std::size_t nearest_;
  TurnShares turns_;
};

}  // namespace trex
