// Bump maps of scene files as normal maps of the surface that they are on.
#pragma once

#include "src/scene/scene.h"

namespace trex::detail {

/// What a bump or normal map needs to know of the surface under it.
struct UvFacts {
  double metresPerUv = 1.0;
  bool rightHanded = false;  ///< u x v is the normal
};

/// Of a mesh at its place; without texture coordinates those above.
UvFacts uvFactsOf(const Mesh& mesh, const dmat4& place);

/// Gives a material the normal map of heights: a linear image, white of which is `metres` high,
/// placed as `heights` is. The image is added to the scene, once for surfaces of similar slopes.
void setBumps(Scene& scene, const Texture& heights, double metres, const UvFacts& facts,
              Material& m);

}  // namespace trex::detail
