#include "src/scene/layered.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "src/scene/fresnel.h"

namespace trex::detail {
namespace {

double schlickWeight(double cosine) { return std::pow(1.0 - cosine, 5.0); }

/// Mean over both hemispheres, weighted by the cosines, of a function of the cosines of both
/// directions with the normal and of one with the half vector.
double meanOverPairs(const std::function<double(double in, double out, double half)>& value) {
  constexpr int kSteps = 24;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double in = (i + 0.5) / kSteps;
    for (int o = 0; o < kSteps; ++o) {
      const double out = (o + 0.5) / kSteps;
      for (int p = 0; p < kSteps; ++p) {
        const double phi = std::numbers::pi * (p + 0.5) / kSteps;
        const double dot =
            in * out + std::sqrt((1.0 - in * in) * (1.0 - out * out)) * std::cos(phi);
        sum += 4.0 * in * out * value(in, out, std::sqrt(std::max(0.0, 0.5 * (1.0 + dot))));
      }
    }
  }
  return sum / (kSteps * kSteps * kSteps);
}

}  // namespace

double diffuseShare(double ior) {
  const double f0 = fresnelReflectance(1.0, ior);
  return meanOverPairs(
      [f0](double, double, double half) { return 1.0 - f0 - (1.0 - f0) * schlickWeight(half); });
}

PlasticGround::PlasticGround(double ior, bool nonlinear)
    : enters_(std::pow(1.0 - meanReflectance(ior), 2.0) / (ior * ior)),
      leavesInner_(meanReflectance(1.0 / ior)),
      share_(diffuseShare(ior)),
      nonlinear_(nonlinear) {}

double PlasticGround::albedo(double reflectance) const {
  return enters_ * reflectance / (1.0 - (nonlinear_ ? reflectance : 1.0) * leavesInner_);
}

double PlasticGround::baseColor(double reflectance) const {
  return std::min(1.0, albedo(reflectance) / share_);
}

double disneyDiffuseAlbedo(double roughness) {
  return meanOverPairs([roughness](double in, double out, double half) {
    const double fi = schlickWeight(in), fo = schlickWeight(out);
    const double retro = 2.0 * roughness * half * half;
    return (1.0 - 0.5 * fi) * (1.0 - 0.5 * fo) + retro * (fi + fo + fi * fo * (retro - 1.0));
  });
}

}  // namespace trex::detail
