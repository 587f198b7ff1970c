// The guess, denoised: an edge-avoiding filter whose width follows the estimated variance, so that
// it fades to nothing as samples grow. Never used on a correction or on an exact picture.
//
// An a-trous wavelet filter [Dammertz et al., HPG 2010] with variance-guided weights in the manner
// of [Schied et al., HPG 2017], on radiance divided by albedo.
#pragma once

#include <vector>

#include "src/frame/features.h"

namespace trex {

/// Filters `radiance` (row by row, width * height of the features) given the variance of each
/// pixel's mean. Non-finite input must not occur. Uses the calling oneTBB arena; deterministic.
std::vector<vec3> denoiseGuess(const FeatureImage& features, const std::vector<vec3>& radiance,
                               const std::vector<vec3>& variance);

}  // namespace trex
