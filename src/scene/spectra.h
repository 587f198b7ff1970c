// Spectra as scene formats give them, and the linear RGB (Rec. 709, D65) that they are shown as.
//
// Sources: CIE 1931 colour matching by the analytic fits of [Wyman, Sloan, Shirley, JCGT 2013];
// daylight D65 of CIE 15; Planck's law with the constants of CODATA 2018.
#pragma once

#include <functional>
#include <vector>

#include "src/core/maths.h"

namespace trex::detail {

/// Values at wavelengths that rise, linear in between; 0 outside for a spectrum that was measured
/// there, which is also how Mitsuba and pbrt read them.
struct SampledSpectrum {
  std::vector<float> nanometres, values;

  float at(double nm) const;
  /// Sorts by wavelength and drops what is not finite.
  void sanitise();
};

/// CIE XYZ in linear Rec. 709; colours out of its gamut have negative parts.
dvec3 rgbOfXyz(const dvec3& xyz);

/// The colour of a surface that reflects (or transmits) this much of daylight D65: a constant 1 is
/// (1, 1, 1). May leave [0, 1] for saturated colours.
vec3 reflectanceRgb(const std::function<double(double nm)>& spectrum);
vec3 reflectanceRgb(const SampledSpectrum& spectrum);

/// The colour of a light with this radiance a nanometre, over the 106.857 nm of the luminous
/// efficiency: an equal-energy spectrum of 1 has the luminance 1. As Mitsuba and pbrt have it.
vec3 emissionRgb(const std::function<double(double nm)>& spectrum);
/// The same in CIE XYZ.
dvec3 emissionXyz(const std::function<double(double nm)>& spectrum);
vec3 emissionRgb(const SampledSpectrum& spectrum);

/// Radiance of a black body, W/(m^2 sr nm). 0 at 0 K and below.
double planck(double nm, double kelvin);

/// emissionRgb() of a black body; `normalised`: of one whose largest value over all wavelengths is
/// 1. Not negative.
vec3 blackbodyRgb(double kelvin, bool normalised);

}  // namespace trex::detail
