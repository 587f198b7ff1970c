// The guess and its correction, denoised: an edge-avoiding filter whose width follows the estimated
// variance, so that it fades to nothing as samples grow. Never used on an exact picture.
//
// An a-trous wavelet filter [Dammertz et al., HPG 2010] with variance-guided weights in the manner
// of [Schied et al., HPG 2017], on radiance divided by albedo. What the correction estimates, the
// bias of a cached guess, varies slowly over surfaces: filtering it apart from the guess keeps the
// guess's detail, and adding only as much of it as stands out of its noise lowers the error [Gu,
// Iglesias-Guitian, Moon, SIGGRAPH Asia 2022].
#pragma once

#include <vector>

#include "src/frame/features.h"

namespace trex {

/// Filters `radiance` (row by row, width * height of the features) given the variance of each
/// pixel's mean. Non-finite input must not occur. Uses the calling oneTBB arena; deterministic.
std::vector<vec3> denoiseGuess(const FeatureImage& features, const std::vector<vec3>& radiance,
                               const std::vector<vec3>& variance);

/// Filters the mean difference between exact paths and guess alike, then scales each pixel's result
/// d, with v its variance after the filter, by d^2 / (d^2 + 4 v). Values may be negative.
std::vector<vec3> denoiseCorrection(const FeatureImage& features,
                                    const std::vector<vec3>& difference,
                                    const std::vector<vec3>& variance);

}  // namespace trex
