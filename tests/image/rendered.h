// What the image, regression and extreme tests share: a scene rendered to means and variances,
// comparisons of two of them, and the pictures kept when a test fails.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/session/session.h"

namespace trex::test {

/// A picture as sums: mean and variance of the mean by pixel, rows from top to bottom, and of the
/// whole picture.
struct Rendered {
  std::uint32_t width = 0, height = 0;
  std::vector<dvec3> mean, variance;
  dvec3 total{0.0}, totalVariance{0.0};
  SessionReport report;
};

/// Settings for a square picture; on the CPU alone unless `device` says otherwise.
RenderSettings settingsFor(std::uint32_t side, double exact, std::uint32_t samples,
                           std::uint32_t seed = 1, int device = RenderSettings::kNoDevice);

/// Renders with the scene's first camera. Non-finite samples fail the test. `voxelDepth` 0: as
/// the program chooses by the picture's size.
Rendered render(Scene scene, const RenderSettings& settings, int voxelDepth = 0);
/// The same for a model made once.
Rendered render(std::shared_ptr<const Model> model, const RenderSettings& settings);

/// Two pictures, pixel by pixel and by blocks of 8 x 8. Pixels are tested with the image's variance
/// pooled over 3 x 3 pixels where that is larger; blocks with the sum of the variances.
struct Comparison {
  double pixelsPassed = 0.0;  ///< share of channels with p above the level of as many tests
  double smallestPixelP = 1.0, smallestBlockP = 1.0;  ///< before any correction
  double blockP = 1.0;        ///< of the worst block, corrected [Šidák 1967]
  double meanRatio = 1.0;     ///< mean of the first over that of the second, all channels
  double worstBlock = 0.0;    ///< largest relative difference of a block's mean, all channels
  double relativeRmse = 0.0;  ///< of pixels, over the second's mean
  std::vector<double> z;      ///< by pixel: largest of its channels, with sign
};

/// z-tests use both variances; equal sizes, multiples of 8.
Comparison compare(const Rendered& image, const Rendered& reference, double level = 0.01);

/// Two-sided p-value of a standard normal deviate.
double pValue(double z);
/// Level of each of `tests` independent tests so that all pass with 1 - level [Šidák 1967].
double sidak(double level, double tests);

/// FLIP (mean) of two pictures as they would be shown, both with the exposure of the second.
double flip(const Rendered& image, const Rendered& reference);
/// Mean of the first over that of the second, channels added.
double ratio(const Rendered& image, const Rendered& reference);

/// Prints "measured NAME: VALUE (limit LIMIT)", the line that docs/tests.md quotes.
void report(const std::string& name, double value, double limit);

/// Writes image, reference, heat map of z (red: too bright, blue: too dark) and the numbers to the
/// artefact folder NAME, and prints where.
void keepArtefacts(const std::string& name, const Rendered& image, const Rendered& reference);
void keepArtefact(const std::string& name, const Rendered& image);

}  // namespace trex::test
