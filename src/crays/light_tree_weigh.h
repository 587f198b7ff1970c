// Eight neighbouring nodes of a light tree, weighed at once for the best instruction set of this
// processor. Every one gives the same bits: all operations are exactly rounded, none is fused.
#pragma once

#include <cstdint>

#include "src/core/maths.h"

namespace trex {

/// Children of a node of a light tree, a lane each; lanes without a child have no power.
struct alignas(64) LightNodes {
  static constexpr std::uint32_t kLanes = 8;

  /// Of the spheres around their boxes.
  float x[kLanes] = {}, y[kLanes] = {}, z[kLanes] = {}, radius[kLanes] = {};
  float axisX[kLanes] = {}, axisY[kLanes] = {}, axisZ[kLanes] = {}, power[kLanes] = {};
  float cosSpread[kLanes] = {}, sinSpread[kLanes] = {}, cosReach[kLanes] = {};
  float bothSides[kLanes] = {};                          ///< 1 if they shine to both sides
  std::uint32_t child[kLanes] = {};                      ///< index of their own children; 0: a leaf
  std::uint32_t first[kLanes] = {}, count[kLanes] = {};  ///< places of their lights
  std::uint32_t children = 0;
};

/// Writes about the irradiance that each gives at a point: 0 only where no light of the node
/// shines. `weights`: kLanes floats, aligned to 32 bytes. Returns a bit for each whose centre is
/// closer than 1.5 of its radii. Thread safe.
using WeighLights = std::uint32_t (*)(const LightNodes& nodes, const vec3& position,
                                      const vec3& normal, float* weights);

/// Obeys hwy::SetSupportedTargetsForTest. Thread safe.
WeighLights chooseWeighLights();

}  // namespace trex
