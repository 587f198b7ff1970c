// FLIP: what a viewer who flips between two pictures sees of their difference.
//
// [Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator
// for Alternating Images", HPG 2020] for pictures in the display's range, [Andersson, Nilsson,
// Shirley, Akenine-Möller, "Visualizing Errors in Rendered High Dynamic Range Images", Eurographics
// 2021] for radiance.
#pragma once

#include <cstdint>
#include <numbers>
#include <vector>

#include "src/core/maths.h"

namespace trex {

/// Pixels in a degree of visual angle on a display 3840 pixels and 0.7 m wide seen from 0.7 m: 67.
inline constexpr double kFlipPixelsPerDegree = 3840.0 * std::numbers::pi / 180.0;
/// What flipMap and hdrFlipMap accept.
inline constexpr double kLeastPixelsPerDegree = 1.0, kMostPixelsPerDegree = 1000.0;

/// Linear Rec. 709 colours, rows from top to bottom.
struct ColorImage {
  std::uint32_t width = 0, height = 0;
  std::vector<vec3> pixels;  ///< width * height
};

/// The error of each pixel, [0, 1]: 0 equal, 1 as different as the display can show. Colours are
/// linear and clamped to [0, 1]; what the display would encode is decoded. Both pictures have one
/// size; not empty, finite. Uses the calling oneTBB arena; equal bits for any number of threads.
std::vector<float> flipMap(const ColorImage& reference, const ColorImage& test,
                           double pixelsPerDegree);

/// Exposures in stops over which HDR-FLIP looks.
struct ExposureRange {
  float start = 0.0f, stop = 0.0f;
  int count = 2;
};

/// From the exposure that brings the reference's largest luminance to 0.85 of the tone mapper's
/// white to the one that does so with its median, a stop apart. Luminances below 2^-23 count as
/// 2^-23, which keeps a black reference finite.
ExposureRange flipExposures(const ColorImage& reference);

/// The largest FLIP of each pixel over the reference's exposures, tone-mapped with the ACES curve.
/// Colours are linear; negative ones count as 0. Otherwise as flipMap.
std::vector<float> hdrFlipMap(const ColorImage& reference, const ColorImage& test,
                              double pixelsPerDegree);

/// Mean of a map, 0 of an empty one.
double meanError(const std::vector<float>& map);

}  // namespace trex
