#include "src/scene/spectra.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace trex::detail {
namespace {

constexpr double kFirst = 360.0, kStep = 1.0;
constexpr std::size_t kWavelengths = 471;

/// A lobe with another width on each side of its middle.
double lobe(double nm, double middle, double left, double right) {
  const double t = (nm - middle) / (nm < middle ? left : right);
  return std::exp(-0.5 * t * t);
}

dvec3 matching(double nm) {
  return {1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7) -
              0.065 * lobe(nm, 501.1, 20.4, 26.2),
          0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1),
          1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8)};
}

/// Relative power of D65, every 10 nm from 360 to 780.
double daylight(double nm) {
  constexpr std::array<double, 43> kTable = {
      46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.486,  93.4318, 86.6823, 104.865,
      117.008, 117.812, 114.861, 115.923, 108.811, 109.354, 107.802, 104.79,  107.689,
      104.405, 104.046, 100.0,   96.3342, 95.788,  88.6856, 90.0062, 89.5991, 87.6987,
      83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.349,
      61.604,  69.8856, 75.087,  63.5927, 46.4182, 66.8054, 63.3828};
  const double at = std::clamp((nm - 360.0) / 10.0, 0.0, double(kTable.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), kTable.size() - 2);
  return std::lerp(kTable[i], kTable[i + 1], at - double(i));
}

dvec3 integrate(const std::function<double(double)>& spectrum) {
  static const auto matchings = [] {
    std::array<dvec3, kWavelengths> table;
    for (std::size_t i = 0; i < table.size(); ++i) table[i] = matching(kFirst + kStep * double(i));
    return table;
  }();
  dvec3 sum(0.0);
  for (std::size_t i = 0; i < matchings.size(); ++i) {
    sum += spectrum(kFirst + kStep * double(i)) * matchings[i] * kStep;
  }
  return sum;
}

}  // namespace

dvec3 rgbOfXyz(const dvec3& c) {
  return {3.2404542 * c.x - 1.5371385 * c.y - 0.4985314 * c.z,
          -0.9692660 * c.x + 1.8760108 * c.y + 0.0415560 * c.z,
          0.0556434 * c.x - 0.2040259 * c.y + 1.0572252 * c.z};
}

float SampledSpectrum::at(double nm) const {
  if (nanometres.empty() || nm < double(nanometres.front()) || nm > double(nanometres.back())) {
    return 0.0f;
  }
  const auto next = std::upper_bound(nanometres.begin(), nanometres.end(), nm);
  if (next == nanometres.end()) return values.back();
  const auto i = static_cast<std::size_t>(next - nanometres.begin());
  const double span = double(nanometres[i]) - double(nanometres[i - 1]);
  return static_cast<float>(
      std::lerp(double(values[i - 1]), double(values[i]), (nm - double(nanometres[i - 1])) / span));
}

void SampledSpectrum::sanitise() {
  const std::size_t count = std::min(nanometres.size(), values.size());
  std::vector<std::pair<float, float>> pairs;
  for (std::size_t i = 0; i < count; ++i) {
    if (std::isfinite(nanometres[i]) && std::isfinite(values[i])) {
      pairs.emplace_back(nanometres[i], values[i]);
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  nanometres.clear();
  values.clear();
  for (const auto& [nm, value] : pairs) {
    nanometres.push_back(nm);
    values.push_back(value);
  }
}

vec3 reflectanceRgb(const std::function<double(double)>& spectrum) {
  static const dvec3 white = rgbOfXyz(integrate(daylight));
  return vec3(rgbOfXyz(integrate([&](double nm) { return spectrum(nm) * daylight(nm); })) / white);
}

vec3 reflectanceRgb(const SampledSpectrum& spectrum) {
  return reflectanceRgb([&](double nm) { return double(spectrum.at(nm)); });
}

dvec3 emissionXyz(const std::function<double(double)>& spectrum) {
  // Each sum by its own, so that equal energy is XYZ (1, 1, 1) in spite of the fits.
  static const dvec3 equalEnergy = integrate([](double) { return 1.0; });
  return integrate(spectrum) / equalEnergy;
}

vec3 emissionRgb(const std::function<double(double)>& spectrum) {
  return vec3(rgbOfXyz(emissionXyz(spectrum)));
}

vec3 emissionRgb(const SampledSpectrum& spectrum) {
  return emissionRgb([&](double nm) { return double(spectrum.at(nm)); });
}

double planck(double nm, double kelvin) {
  constexpr double kPlanck = 6.62607015e-34, kLight = 299792458.0, kBoltzmann = 1.380649e-23;
  if (!(kelvin > 0.0)) return 0.0;
  const double metres = nm * 1e-9;
  const double exponent = kPlanck * kLight / (metres * kBoltzmann * kelvin);
  return 2.0 * kPlanck * kLight * kLight / std::pow(metres, 5.0) / std::expm1(exponent) * 1e-9;
}

vec3 blackbodyRgb(double kelvin, bool normalised) {
  constexpr double kWien = 2.897771955e6;  // nm K
  const double most = normalised && kelvin > 0.0 ? planck(kWien / kelvin, kelvin) : 1.0;
  return glm::max(emissionRgb([&](double nm) { return planck(nm, kelvin) / most; }), vec3(0.0f));
}

}  // namespace trex::detail
