// The costly passes of the filter in denoise.h, row by row, for the best instruction set of this
// processor. Every one gives the same bits: a lane does all operations of one pixel, in the same
// order whatever the number of lanes, and all of them are exactly rounded.
//
// Memory: a plane a quantity, the planes of a row beside each other. Margins on both sides, and
// what rounds a row up to whole vectors, hold pixels that are like no other, so that no neighbour
// needs a test of x:
//
//   floats   kMargin | width, rounded up to kRound | kMargin
//             ...        row y, plane 0 ...
//             ...        row y, plane 1 ...
#pragma once

#include <cstddef>

#include "src/core/maths.h"

namespace trex {

/// What a pixel shows, for the weights.
enum GuidePlane : std::size_t {
  kNormal = 0,    ///< three planes; unit, zero where nothing is shown
  kLength = 3,    ///< of the mean normal: 0 shows nothing, kOutside is no pixel
  kPosition = 4,  ///< three planes, metres
  kSlope = 7,     ///< kLength / (tolerated distance from the surface's plane), 1/metres
  kAlbedo = 8,    ///< three planes
  kCover = 11,    ///< share of the pixel's samples * luminance of the albedo: weight of its light
  kGuidePlanes = 12
};

constexpr float kNoiseTolerance = 3.0f;  ///< differences below this many deviations are noise
constexpr float kFarApart = 20.0f;       ///< exponents beyond count as infinite

/// Of three planes, a pixel.
inline vec3 getThree(const float* at, std::size_t stride) {
  return {at[0], at[stride], at[2 * stride]};
}
inline void putThree(const vec3& v, float* at, std::size_t stride) {
  at[0] = v.x;
  at[stride] = v.y;
  at[2 * stride] = v.z;
}

/// kSlope by the length of the mean normal and the width of a pixel there.
inline float slopeOf(float length, float footprint) {
  constexpr float kPlaneTolerance = 2.0f;  // pixel widths off the surface's plane
  return length / (kPlaneTolerance * footprint + 1e-30f);
}
/// Light without texture.
enum CellPlane : std::size_t {
  kLight = 0,     ///< three planes
  kBright = 3,    ///< luminance of the light
  kVariance = 4,  ///< of the luminance
  kCellPlanes = 5
};

/// Light that the filter took from a pixel, to be given back around it: three planes.
constexpr std::size_t kLostPlanes = 3;

/// The filter's memory, owned elsewhere. Copies see the same.
struct FilterPlanes {
  static constexpr int kIterations = 5;  // steps of 1, 2, 4, 8, 16 pixels
  static constexpr std::size_t kMargin = 2u << (kIterations - 1);
  static constexpr std::size_t kRound = 16;  // floats of the widest vector, a line of cache
  static constexpr float kOutside = -1.0f;

  int width = 0, height = 0;
  std::size_t stride = 0;    ///< floats of a plane's row, margins included
  float* guides = nullptr;   ///< height * kGuidePlanes * stride
  float* cells = nullptr;    ///< height * kCellPlanes * stride: read
  float* written = nullptr;  ///< as many
  float* lost = nullptr;     ///< height * kLostPlanes * stride; null if nothing is given back

  /// An odd number of cache lines, or planes would compete for the same sets of the cache.
  static std::size_t strideOf(std::size_t width) {
    return ((width + kRound - 1) / kRound * kRound + 2 * kMargin) | kRound;
  }
  /// Pixel 0 of the first plane of row y.
  float* guideRow(int y) const { return row(guides, kGuidePlanes, y); }
  float* cellRow(int y) const { return row(cells, kCellPlanes, y); }
  float* writtenRow(int y) const { return row(written, kCellPlanes, y); }
  float* lostRow(int y) const { return row(lost, kLostPlanes, y); }

 private:
  float* row(float* base, std::size_t planes, int y) const {
    return base + static_cast<std::size_t>(y) * planes * stride + kMargin;
  }
};

/// Different rows may run at once. The first three read guides and cells and write row y of
/// `written`; the others together spread what was lost over 3x3 pixels `step` apart that show the
/// same surface, so that the sum of light times kCover stays what it was: each
/// pixel shares out all that it has.
struct FilterKernels {
  /// Light as it is; variances not below the mean of their neighbourhood.
  void (*smoothVariance)(const FilterPlanes& planes, int y);
  /// The same, nor below the variance between the pixels of it: where there are few samples.
  void (*spreadVariance)(const FilterPlanes& planes, int y);
  /// The weighted mean of 5x5 pixels `step` apart, and its variance.
  void (*gather)(const FilterPlanes& planes, int y, int step);
  /// What a pixel gives for a weight of one, from `lost` to the light of `written`.
  void (*share)(const FilterPlanes& planes, int y, int step);
  /// What it is given, from there to `lost`.
  void (*collect)(const FilterPlanes& planes, int y, int step);
};

/// Obeys hwy::SetSupportedTargetsForTest. Thread safe.
FilterKernels chooseFilterKernels();

}  // namespace trex
