#include "src/scene/spectra.h"

#include <gtest/gtest.h>

#include "src/scene/fresnel.h"

namespace trex::detail {
namespace {

void expectNear(const vec3& a, const vec3& b, float tolerance) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance) << "channel " << c;
}

TEST(Spectra, ConstantReflectanceIsGrey) {
  expectNear(reflectanceRgb([](double) { return 0.25; }), vec3(0.25f), 1e-6f);
}

TEST(Spectra, EqualEnergyHasLuminanceOneAndItsKnownColour) {
  const vec3 e = emissionRgb([](double) { return 1.0; });
  // XYZ (1, 1, 1) in linear sRGB.
  expectNear(e, vec3(1.2048f, 0.9483f, 0.9089f), 2e-3f);
  EXPECT_NEAR(luminance(e), 1.0f, 1e-3f);
}

TEST(Spectra, RampsByTheTabulatedObserver) {
  const SampledSpectrum ramp{{400.0f, 700.0f}, {0.1f, 0.9f}};
  expectNear(reflectanceRgb(ramp), vec3(0.7429f, 0.4811f, 0.2083f), 0.008f);
  expectNear(emissionRgb(ramp), vec3(0.8722f, 0.4587f, 0.1813f), 0.008f);
  const SampledSpectrum hat{{360.0f, 550.0f, 830.0f}, {0.0f, 0.8f, 0.1f}};
  expectNear(reflectanceRgb(hat), vec3(0.6337f, 0.7455f, 0.3541f), 0.008f);
  expectNear(emissionRgb(hat), vec3(0.7611f, 0.7121f, 0.3120f), 0.008f);
}

TEST(Spectra, SamplesAreLinearInBetweenAndNothingOutside) {
  SampledSpectrum s{{700.0f, 400.0f, std::nanf("")}, {3.0f, 1.0f, 2.0f}};
  s.sanitise();
  EXPECT_FLOAT_EQ(s.at(400.0), 1.0f);
  EXPECT_FLOAT_EQ(s.at(550.0), 2.0f);
  EXPECT_FLOAT_EQ(s.at(700.0), 3.0f);
  EXPECT_EQ(s.at(399.0), 0.0f);
  EXPECT_EQ(s.at(701.0), 0.0f);
  EXPECT_EQ(SampledSpectrum{}.at(500.0), 0.0f);
}

TEST(Spectra, BlackBodiesByPlanckAndTheirColours) {
  // Stefan and Boltzmann: the radiance over all wavelengths is sigma T^4 / pi.
  double sum = 0.0;
  for (double nm = 50.0; nm < 50'000.0; nm += 5.0) sum += planck(nm, 5000.0) * 5.0;
  EXPECT_NEAR(sum / (5.670374e-8 * std::pow(5000.0, 4.0) / std::numbers::pi), 1.0, 2e-3);
  // By the tabulated CIE 1931 observer, every nanometre from 360 to 830.
  expectNear(blackbodyRgb(3000.0, true), vec3(0.7366f, 0.3512f, 0.1132f), 0.008f);
  expectNear(blackbodyRgb(6500.0, true), vec3(0.9242f, 0.8713f, 0.9170f), 0.008f);
  EXPECT_NEAR(blackbodyRgb(3000.0, false).x / 733.11f, 1.0f, 0.01f);
  expectNear(blackbodyRgb(0.0, true), vec3(0.0f), 0.0f);
}

TEST(Fresnel, DielectricByTheClosedForm) {
  EXPECT_NEAR(fresnelReflectance(1.0, 1.5), 0.04, 1e-12);
  EXPECT_NEAR(fresnelReflectance(0.0, 1.5), 1.0, 1e-12);
  // At Brewster's angle half of the perpendicular part is left: ((1 - n^2) / (1 + n^2))^2 / 2.
  const double brewster = std::cos(std::atan(1.5));
  EXPECT_NEAR(fresnelReflectance(brewster, 1.5), 0.5 * std::pow(1.25 / 3.25, 2.0), 1e-12);
  // Beyond the critical angle all of it.
  EXPECT_NEAR(fresnelReflectance(0.5, 1.0 / 1.5), 1.0, 1e-12);
  EXPECT_NEAR(fresnelReflectance(0.7, {0.0, 1.0}), 1.0, 1e-12);
}

TEST(Fresnel, MeansOfAllAngles) {
  EXPECT_NEAR(meanReflectance(1.5), 0.0918, 1e-4);
  EXPECT_NEAR(meanReflectance(1.0), 0.0, 1e-9);
  // What gets out of the denser side: (1 - R_in) = (1 - R_out) / n^2, a reciprocity of the means.
  EXPECT_NEAR(1.0 - meanReflectance(1.0 / 1.5), (1.0 - meanReflectance(1.5)) / 2.25, 1e-4);
}

TEST(Fresnel, ConductorsByName) {
  const auto gold = conductorNamed("Au");
  ASSERT_TRUE(gold);
  expectNear(gold->normalReflectance(), vec3(0.966f, 0.791f, 0.310f), 0.03f);
  EXPECT_GT(conductorNamed("Ag")->normalReflectance().z, 0.85f);
  const vec3 aluminium = conductorNamed("Al")->meanReflectance();
  EXPECT_NEAR(aluminium.y, 0.905f, 0.02f);
  expectNear(conductorNamed("none")->meanReflectance(), vec3(1.0f), 1e-6f);
  EXPECT_TRUE(conductorNamed("Cu_palik"));
  EXPECT_FALSE(conductorNamed("Unobtainium"));
  EXPECT_FALSE(conductorNamed(""));
}

TEST(Fresnel, DielectricsByName) {
  EXPECT_FLOAT_EQ(*dielectricNamed("BK7"), 1.5046f);
  EXPECT_FLOAT_EQ(*dielectricNamed("diamond"), 2.419f);
  EXPECT_FLOAT_EQ(*dielectricNamed("water_ice"), 1.31f);
  EXPECT_FALSE(dielectricNamed("glue"));
}

}  // namespace
}  // namespace trex::detail
