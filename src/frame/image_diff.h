// How far a picture is from a reference: hard differences first, then figures.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "src/frame/flip.h"
#include "src/frame/image_file.h"
#include "src/frame/z_test.h"

namespace trex {

/// Values that are NaN or infinite, over all channels.
struct NonFinite {
  std::uint64_t count = 0;
  std::uint32_t x = 0, y = 0;  ///< of the first, row by row
  std::string channel;
};

/// relMSE: (x - r)^2 / (r^2 + 0.01 m^2), m the mean of the reference, averaged over pixels and
/// channels. A term is 0 where x equals r, and infinite where only a black reference differs.
struct RelativeError {
  double all = 0.0;
  double trimmed = 0.0;  ///< without the largest 0.1 % of the terms, one at least
};

/// Over R, G, B; linear unless said otherwise.
struct DiffFigures {
  double rmse = 0.0;
  RelativeError relative;
  std::optional<double> psnrDb;  ///< of the displayed pictures, peak 1; none where they are equal
  double maxError = 0.0;
  std::uint32_t maxX = 0, maxY = 0;
  char maxChannel = 'R';
  double meanRatio = 1.0;  ///< mean of the picture over the mean of the reference
  double flip = 0.0;       ///< mean LDR-FLIP of the displayed pictures
  double hdrFlip = 0.0;    ///< mean HDR-FLIP
  double exposure = 0.0;   ///< stops, of the displayed pictures
  std::vector<float> flipMap, hdrFlipMap;
  std::optional<ZTest> zTest;  ///< where both pictures have variance.R, .G, .B
};

struct ImageDiff {
  std::uint32_t widthA = 0, heightA = 0, widthB = 0, heightB = 0;
  std::vector<std::string> onlyInA, onlyInB;  ///< names of channels
  NonFinite nonFiniteA, nonFiniteB;
  bool equalBits = false;  ///< every value of every channel; metadata is not compared
  /// None where sizes differ, colours are missing or a colour is not finite.
  std::optional<DiffFigures> figures;
  std::vector<std::string> reasons;  ///< no comparison allows for them; a sentence each
};

struct DiffOptions {
  double pixelsPerDegree = kFlipPixelsPerDegree;
  /// Stops of the displayed pictures; none: automatic, see displayScale.
  std::optional<double> exposure;
};

/// Compares picture `a` with reference `b`. Throws Error(kInput) where both lack a colour. Uses the
/// calling oneTBB arena; equal bits for any number of threads.
ImageDiff compareImages(const Picture& a, const Picture& b, const DiffOptions& options);

/// R, G and B of a picture. Throws Error(kInput) if one is missing; `name` opens the message.
ColorImage colorsOf(const Picture& picture, const std::string& name);

/// The factor that brings the 70th percentile of the reference's mean channel to 0.5 (the
/// percentile interpolated between ranks, at least 1e-12).
double displayScale(const ColorImage& reference);

/// What a display shows, before its encoding: scaled and clamped to [0, 1].
ColorImage displayed(const ColorImage& image, double scale);

RelativeError relativeError(const ColorImage& image, const ColorImage& reference);
/// Mean of all values of all three channels.
double meanValue(const ColorImage& image);

/// The magma colour map of Matplotlib, sRGB-encoded; x in [0, 1].
vec3 magma(float x);

}  // namespace trex
