// What a surface point sends out by itself, and how much of it is there: read alike by hits, light
// sampling, photons and voxels.
#pragma once

#include <vector>

#include "src/scene/scene.h"

namespace trex {

/// Emitted radiance of a material at texture coordinates, W/(m^2 sr); of what is there, so
/// coverageAt() is not in it. Thread safe, as are the others.
vec3 emissionAt(const Material& material, const std::vector<Image>& images, const TexCoords& uv);

/// Share of a surface that is there, [0, 1], where its alpha (factor, texture and vertex colour
/// multiplied) is known: glTF's alpha modes.
float coverageOf(const Material& material, float alpha);
/// The same where it is not.
float coverageAt(const Material& material, const std::vector<Image>& images, const TexCoords& uv,
                 float vertexAlpha);

}  // namespace trex
