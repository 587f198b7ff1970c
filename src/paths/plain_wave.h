// The plain surfaces of a wave (plain_lanes.h): decoded and shaded together, whatever kind of path
// has met them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/core/sampler.h"
#include "src/crays/bsdf.h"
#include "src/crays/plain_lanes.h"
#include "src/crays/ray_scene.h"

namespace trex {

/// A plain surface in its lanes.
struct PlainAt {
  const PlainLanes& lanes;
  std::size_t lane;

  vec3 facing() const { return PlainLanes::vector(lanes.facing, lane); }
  /// As those of Bsdf.
  bool cacheable() const {
    return lanes.specularLobe[lane] * lanes.metallic[lane] <= Bsdf::kMostSharp;
  }
  bool leavesFront(const vec3& to) const { return lanes.leavesFront(to, lane); }
  float photonFactor(const vec3& to) const { return lanes.photonFactor(to, lane); }
};

/// Places of plain surfaces in lanes, given in the order of paths. Private to a thread.
struct PlainWave {
  static constexpr std::size_t kMost = 16;
  static constexpr std::uint8_t kNotPlain = 0xff;

  std::array<PlainLanes, kMost / PlainLanes::kLanes> plain{};
  std::size_t plainCount = 0;  ///< surfaces in them

  static std::size_t blockOf(std::uint8_t place) { return place / PlainLanes::kLanes; }
  static std::size_t laneOf(std::uint8_t place) { return place % PlainLanes::kLanes; }
  const PlainLanes& lanesOf(std::uint8_t place) const { return plain[blockOf(place)]; }
  PlainAt at(std::uint8_t place) const { return {lanesOf(place), laneOf(place)}; }

  using Samples = std::array<PlainSamples, kMost / PlainLanes::kLanes>;
  /// Numbers for Bsdf::sample().
  static void draw(std::uint8_t place, Sampler& sampler, Samples& samples) {
    PlainSamples& of = samples[blockOf(place)];
    const std::size_t lane = laneOf(place);
    of.choice[lane] = sampler.next1D();
    const vec2 u = sampler.next2D();
    of.u[lane] = u.x, of.v[lane] = u.y;
  }
  /// What these chose. False if nothing.
  static bool sampled(std::uint8_t place, const Samples& samples, BsdfSample& next) {
    const PlainSamples& of = samples[blockOf(place)];
    const std::size_t lane = laneOf(place);
    if (!PlainLanes::is(of.found, lane)) return false;
    next.direction = PlainLanes::vector(of.direction, lane);
    next.weight = PlainLanes::vector(of.weight, lane);
    next.pdf = of.pdf[lane];
    next.roughness = of.roughness[lane];
    return true;
  }

  std::size_t plainBlocks() const {
    return (plainCount + PlainLanes::kLanes - 1) / PlainLanes::kLanes;
  }
};

/// The plain materials of a scene. Immutable, so thread safe.
class PlainSurfaces {
 public:
  /// Both must outlive it. Lobes of an alpha up to `leastAlpha`, at least kClearAlpha, are left
  /// out.
  PlainSurfaces(const Scene& scene, const RayScene& rays, float leastAlpha);
  /// No surface is plain.
  static PlainSurfaces none(const Scene& scene, const RayScene& rays);

  // In this order for all surfaces of a wave; its plainCount is 0 before.

  /// The corners of a hit of a ray along `direction`, in the next place; kNotPlain if it is not
  /// plain, as far as is known without its textures. Of `surface` it sets what textures are read
  /// by.
  std::uint8_t decode(const RayHit& hit, const vec3& direction, PlainWave& wave,
                      Surface& surface) const;
  bool textured(std::uint32_t material) const { return materials_[material].textured(); }
  /// The material, as Bsdf has it.
  void colour(std::uint8_t place, const Surface& surface, PlainWave& wave) const;
  void shade(PlainWave& wave) const;
  /// What rays ask of the surface. False if it turns out not to be plain: it has to be decoded
  /// anew.
  bool finish(std::uint8_t place, const PlainWave& wave, Surface& surface) const;

  const PlainKernels& kernels() const { return *kernels_; }

 private:
  const Scene& scene_;
  const RayScene& rays_;
  std::vector<PlainMaterial> materials_;  ///< empty: no surface is plain
  float leastAlpha_;
  const PlainKernels* kernels_;
};

}  // namespace trex
