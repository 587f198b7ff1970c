// Images made of others, for formats that keep in several files what a material here has in one.
#pragma once

#include "src/scene/scene.h"

namespace trex::detail {

/// The colours of an image (null: white) with the opacity of another: its alpha channel if it has
/// one, else its brightness. As large as the one with the most texels.
Image withOpacity(const Image* color, const Image& opacity);

/// Green of the first image's red, blue of the second's, as metallic-roughness wants them; one of
/// them may be null and counts as one.
Image roughnessAndMetallic(const Image* roughness, const Image* metallic);

/// Roughness in green, as above: 1 - factor * alpha, without an alpha channel 1 - factor. One texel
/// of that if the image is empty.
Image roughnessOfGlossiness(const Image& glossy, float factor);

/// Whether an image looks like a tangent space normal map: its mean is near that of (0, 0, 1).
bool looksLikeNormals(const Image& image);

/// Normals of heights from 0 to 1: `strength` is the slope of a step of 1 from a texel to the next.
Image normalsOfHeights(const Image& heights, float strength);

}  // namespace trex::detail
