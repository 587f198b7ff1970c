// Cached light, read at exact surface points (guess G1): irradiance of the ASVO's voxels, or
// another that a benchmark puts in its place; and the footprint rule that says when a ray may end
// in it.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "asvo/tracer.h"
#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/crays/photon_lots.h"
#include "src/crays/turn_shares.h"

namespace trex {

/// How coarse a gathering ray may look.
struct FootprintRule {
  /// Tangent of the half angle that one diffuse gathering ray stands for.
  float diffuseSpread = 0.2f;
  /// A ray may end in the cache once its footprint's radius reaches this many leaf voxels.
  float cacheVoxels = 1.0f;

  /// Half-angle tangent of a lobe with GGX alpha `roughness` (1: diffuse; 0: a mirror).
  float spread(float roughness) const {
    return roughness >= 1.0f ? diffuseSpread : std::min(diffuseSpread, 0.5f * roughness);
  }
};

/// Light where rays end that need not go on. Immutable while it is used from several threads.
class CachedLight {
 public:
  virtual ~CachedLight() = default;
  /// Edge of what it is made of, metres; 0: of points.
  virtual float leafSize() const = 0;
  /// Length below which it knows no detail, metres: it serves rays with wider footprints. 0: all.
  virtual float detail() const { return leafSize(); }
  /// Irradiance at a surface point on the side of `normal`, W/m^2. `radius`: of the footprint,
  /// metres; `jitter` in [0, 1)^2. False where nothing is known, and the ray goes on.
  virtual bool irradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                          vec3& out) const = 0;
  /// The same, and a picture of its noise: a value alike for all reads of a place, of expectation 0
  /// and the variance that `out` has as other photons might have come. 0 if nothing is known of it.
  /// `lot`: which of several pictures, below PhotonLots::kLots.
  virtual bool noisyIrradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                               std::uint32_t /*lot*/, vec3& out, vec3& noise) const {
    noise = vec3(0.0f);
    return irradiance(position, normal, radius, jitter, out);
  }
  /// Of the light at a place what had turned at most so many times before it came there, [0, 1]:
  /// see TurnShares.
  virtual float shareOfTurns(const vec3& /*position*/, std::uint32_t /*turns*/) const {
    return 1.0f;
  }
};

/// Reads a tree and its light; setLight() while nobody does.
class LightCache final : public CachedLight {
 public:
  /// The tree must outlive the cache. Without setLight() nothing is found.
  explicit LightCache(const asvo::Tree& tree);
  /// `light` as in asvo_layout.h, in units of `scale` W/m^2, of so many photons: the more there
  /// are, the finer are the voxels that footprints read. The span must stay valid. So must
  /// `before`: the same of the first `photonsBefore` of the photons, which tells the noise; 0:
  /// there is none.
  void setLight(std::span<const asvo::uvec4> light, double scale, double photons,
                std::span<const asvo::uvec4> before = {}, double photonsBefore = 0.0);
  /// How often the photons of this light have turned.
  void setTurns(TurnShares turns) { turns_ = std::move(turns); }
  /// What lots of them brought; none are known after setLight().
  void setLots(PhotonLots lots) { lots_ = std::move(lots); }

  bool hasLight() const { return !light_.empty(); }
  double scale() const { return static_cast<double>(scale_); }
  /// Makes all light so many times as strong: a preview of changed lights.
  void scaleLight(double factor) { scale_ *= static_cast<float>(factor); }

  /// Edge of a leaf voxel, metres.
  float leafSize() const override { return leafSize_; }
  /// Of few photons, edge of the voxels that are read at least.
  float detail() const override { return leafSize_ * static_cast<float>(1u << least_); }
  const asvo::Tracer& tracer() const { return tracer_; }

  /// Irradiance at a surface point on the side of `normal`, from the level that the footprint
  /// (radius, metres) asks for. `jitter` in [0, 1)^2 moves the point by up to half a voxel along
  /// the surface, so that voxel borders average out. False if no voxel there has area, or
  /// the surface stands across the normal of what the voxel holds, or the voxel holds layers that
  /// hide each other.
  bool irradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                  vec3& out) const override;
  /// What a lot of photons has too much in the cell (PhotonLots); and what the later photons add to
  /// the mean of the earlier ones, beside what they add to the cell, scaled to the noise of all.
  /// Lights of few photons that samples were read from before have nothing to do with it.
  bool noisyIrradiance(const vec3& position, const vec3& normal, float radius, vec2 jitter,
                       std::uint32_t lot, vec3& out, vec3& noise) const override;
  float shareOfTurns(const vec3& position, std::uint32_t turns) const override {
    return turns_.at(position, turns);
  }

 private:
  /// A voxel and the side of it that faces the same way.
  struct Place {
    std::uint32_t voxel = asvo::ASVO_NONE;
    bool front = true;
  };
  /// Of the levels of a tree this one is a table, from where places are looked for.
  static constexpr std::uint32_t kTable = 5;
  std::uint32_t voxelAt(const vec3& position, std::uint32_t level) const;
  Place find(const vec3& position, const vec3& normal, float radius, vec2 jitter) const;
  vec3 read(std::span<const asvo::uvec4> light, const Place& place) const;

  asvo::Tracer tracer_;
  std::span<const asvo::uvec2> nodes_;
  std::vector<std::uint32_t> table_;  ///< by cell, x first; empty where the tree has fewer levels
  std::span<const asvo::uvec4> light_, before_;
  TurnShares turns_;
  PhotonLots lots_;
  asvo::AsvoInfo info_{};
  float leafSize_ = 0.0f;
  float scale_ = 1.0f;
  float noiseScale_ = 0.0f;    ///< of light_ less before_
  std::uint32_t least_ = 0;    ///< levels that every footprint goes up
  std::uint32_t coarser_ = 0;  ///< levels that a wide footprint may go up
};

}  // namespace trex
