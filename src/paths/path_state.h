// All that a path knows between two rays: plain data, so that a path may wait, be sorted, or go on
// elsewhere. What a sample is worth depends on it and on the scene alone.
#pragma once

#include <cstdint>
#include <type_traits>

#include "src/core/maths.h"
#include "src/core/sampler.h"
#include "src/crays/clear_path.h"
#include "src/crays/ray_scene.h"

namespace trex {

/// A path is traced once for guess and exact light, as long as both agree: `coupled`. Lengths are
/// metres in render space.
struct PathState {
  std::uint32_t job;        ///< place of its sample among those asked for
  std::uint32_t number;     ///< of the sample of its pixel
  Sampler::State random{};  ///< where its numbers go on; in a wave its Sampler knows
  RayStart start{};         ///< of the next ray
  vec3 direction{0.0f};
  float tnear = 0.0f;
  vec3 throughput{1.0f}, absorption{0.0f};  ///< absorption: of the volume there, 1/m
  /// The last point that scattered, reflected or bent the path, and its normal if light of one side
  /// counts there, else zero; where the path left it, and what refraction did to it since.
  dvec3 vertex{0.0};
  vec3 vertexNormal{0.0f};
  RayStart left{};
  ClearPath clear{};
  float travelled = 0.0f;  ///< from the vertex to `start`, through transparent layers and glass
  float scatterPdf = kInfinity;  ///< density of the direction at the vertex; infinite after a delta
  float roughness = 0.0f;        ///< of the last lobe
  float roulette = 1.0f;         ///< undoes the radiance scaling of refraction
  float length = 0.0f;           ///< from the eye to the last surface
  std::uint16_t turns = 0;       ///< times scattered or reflected: what Scene::maxBounces counts
  std::uint16_t bounces = 0;
  std::uint16_t layers = 0;     ///< of the bounces, those through transparent layers
  std::uint16_t scattered = 0;  ///< times, mirrors and clear glass not counted
  bool paired = false;          ///< the exact light is asked for as well
  bool look = false;            ///< ends at the surface that the eye knows
  bool coupled = true;
  bool coneRay = false;  ///< the vertex hands its far field to a cone
  bool seen = false;     ///< the feature is known
  bool spread = false;  ///< by a broad lobe: what sharp ones make of point-like lights is a caustic
  bool certain = true;  ///< mirrors alone so far, and no choice
  bool byRays = false;  ///< asks for no cones; it may go on in the place of one

  /// Density of the direction at the vertex if light sampling there finds what comes next, else
  /// infinite.
  float density() const { return clear.straight(direction) ? scatterPdf : kInfinity; }
  /// The direction at the vertex.
  const vec3& aim() const { return clear.begun() ? clear.direction() : direction; }
  /// The path of the guess alone, in the place of the cone that it was handed to.
  PathState resumed() const {
    PathState path = *this;
    path.coupled = path.byRays = true;
    path.paired = false;
    return path;
  }
  /// A transparent layer or clear glass is left behind, `distance` along the ray.
  void pass(float distance) {
    if (clear.begun()) clear.advance(distance);
    travelled += distance;
  }
};
// Its bytes are all of it; GLM's vectors, asked to start at zero, only do not say so.
static_assert(std::is_standard_layout_v<PathState> && std::is_trivially_destructible_v<PathState>);
static_assert(sizeof(PathState) <= 264);

}  // namespace trex
