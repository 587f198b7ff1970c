// Colours of pbrt's parameters: RGB, XYZ, spectra (inline, by file or by name) and black bodies.
//
// Of lights, pbrt-v3 takes RGB as it is, a spectrum by the CIE's functions over 106.857 nm, and
// "blackbody" [T scale] as a black body whose largest value is 1, times the scale. pbrt-v4 takes
// RGB as multiples of the colour space's illuminant at one unit of luminance, so as it is too;
// every other spectrum gets the luminance 1. Of surfaces, a spectrum is seen in daylight (D65).
#pragma once

#include <algorithm>
#include <map>
#include <memory>
#include <optional>

#include "src/scene/fresnel.h"
#include "src/scene/pbrt_context.h"
#include "src/scene/spectra.h"

namespace trex::detail {

/// In [0, 1]; not-a-number is 0.
inline float clampedUnit(float x) { return x > 0.0f ? std::min(x, 1.0f) : 0.0f; }
/// An amount of light that later products keep finite; not-a-number and less than 0 are 0.
inline vec3 clampedLight(vec3 color) {
  for (int c = 0; c < 3; ++c) color[c] = color[c] > 0.0f ? std::min(color[c], 1e30f) : 0.0f;
  return color;
}

class PbrtColors {
 public:
  explicit PbrtColors(PbrtContext& context) : context_(context) {}

  /// Of files of pbrt-v4, whose lights are normalised.
  bool version4 = false;
  /// Of "rgb" values that follow: srgb, dci-p3, rec2020 or aces2065-1. False if there is no such.
  bool setSpace(const std::string& name);

  /// What a surface reflects or lets pass; may leave [0, 1]. Nothing if the parameter is absent, a
  /// texture, or wrong (which is said).
  std::optional<vec3> reflectance(const PbrtParameters& parameters, std::string_view name);
  /// What a light sends out, not negative.
  std::optional<vec3> light(const PbrtParameters& parameters, std::string_view name);
  /// Of a conductor: the parameters `eta` and `k`, copper's if absent.
  ComplexIor conductor(const PbrtParameters& parameters, std::string_view eta, std::string_view k);
  /// A refractive index: a number, or a spectrum at the yellow line of sodium; in [1, 10].
  float index(const PbrtParameters& parameters, std::string_view name, float otherwise);

 private:
  using Spectrum = std::shared_ptr<const SampledSpectrum>;

  Spectrum spectrumOf(const PbrtParameter& parameter);
  Spectrum spectrumOfFile(const std::string& name);
  std::optional<vec3> indexPart(const PbrtParameters& parameters, std::string_view name,
                                bool absorbing);
  std::optional<vec3> triple(const PbrtParameter& parameter);

  PbrtContext& context_;
  glm::dmat3 toRec709_{1.0};
  std::map<std::string, Spectrum> files_;
};

}  // namespace trex::detail
