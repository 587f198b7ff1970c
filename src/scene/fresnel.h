// Reflectances of smooth interfaces and indices of refraction by name, for scene formats that tell
// those where a material here has a colour.
#pragma once

#include <complex>
#include <optional>
#include <string>

#include "src/core/maths.h"
#include "src/scene/scene.h"

namespace trex::detail {

/// Unpolarised Fresnel reflectance. cosine in [0, 1] on the incident side; eta + i k: index of the
/// far side over that of the near one (k = 0: a dielectric). 1 at total internal reflection.
double fresnelReflectance(double cosine, std::complex<double> index);

/// Share of light from everywhere on one side that is reflected: the mean over the hemisphere,
/// weighted by the cosine.
double meanReflectance(std::complex<double> index);

/// Index of refraction of a conductor, by colour.
struct ComplexIor {
  vec3 eta{0.0f}, k{1.0f};

  vec3 normalReflectance() const;
  /// meanReflectance() by colour.
  vec3 meanReflectance() const;
};

/// Makes the material a metal of this index, which is clamped to what Finish holds, and of a white
/// base colour, which multiplies the reflectance.
void setMetal(const ComplexIor& index, Material& material);
/// The material with the metal's mean reflectance in its base colour, at all angles.
Material withMeanMetal(Material material);

/// A conductor by its chemical name ("Au", "Cu", "Al", "CuZn", "a-C"...; "Cu_palik" is "Cu"): eta
/// and k of measured spectra [Palik 1998], each seen under D65. "none" is a perfect mirror. Nothing
/// if the name is not known.
std::optional<ComplexIor> conductorNamed(const std::string& name);

/// Index of refraction of a dielectric ("bk7", "water", "diamond", "air"...), of visible light.
/// Case does not count. Nothing if the name is not known.
std::optional<float> dielectricNamed(std::string name);

}  // namespace trex::detail
