#include "src/frame/flip.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include "src/frame/separable_filter.h"

namespace trex {
namespace {

// Exponents and the place of the knee of the colour error, exponent and width in degrees of the
// feature detectors [2020, sections 4.1 and 4.2].
constexpr float kColorExponent = 0.7f;
constexpr float kKneeInput = 0.4f, kKneeOutput = 0.95f;
constexpr float kFeatureExponent = 0.5f;
constexpr double kFeatureWidth = 0.082;

/// A contrast sensitivity function: the sum of two Gaussians a sqrt(pi / b) exp(-pi^2 x^2 / b), x
/// in degrees [2020, table 1].
struct Sensitivity {
  double a1, b1, a2, b2;
};
constexpr Sensitivity kAchromatic{1.0, 0.0047, 0.0, 1e-5};
constexpr Sensitivity kRedGreen{1.0, 0.0053, 0.0, 1e-5};
constexpr Sensitivity kBlueYellow{34.1, 0.04, 13.5, 0.025};
constexpr double kWidestB = 0.04;

/// CIE XYZ of linear Rec. 709 under D65, divided by XYZ of white; by rows.
struct Conversion {
  vec3 x, y, z;
  vec3 operator()(const vec3& v) const { return {glm::dot(x, v), glm::dot(y, v), glm::dot(z, v)}; }
};

glm::dmat3 rowsToXyz() {
  glm::dmat3 rows({0.41238656, 0.35759149, 0.18045049}, {0.21263682, 0.71518298, 0.0721802},
                  {0.01933062, 0.11919716, 0.95037259});
  for (int i = 0; i < 3; ++i) rows[i] /= rows[i].x + rows[i].y + rows[i].z;
  return rows;
}

Conversion conversionOf(const glm::dmat3& rows) {
  return {vec3(rows[0]), vec3(rows[1]), vec3(rows[2])};
}

const Conversion kToXyz = conversionOf(rowsToXyz());
// The inverse of a matrix held by rows is the inverse held by rows.
const Conversion kFromXyz = conversionOf(glm::inverse(rowsToXyz()));

/// An opponent space that is linear in radiance.
vec3 toYCxCz(const vec3& linear) {
  const vec3 xyz = kToXyz(linear);
  return {116.0f * xyz.y - 16.0f, 500.0f * (xyz.x - xyz.y), 200.0f * (xyz.y - xyz.z)};
}

vec3 fromYCxCz(const vec3& c) {
  const float y = (c.x + 16.0f) / 116.0f;
  return kFromXyz(vec3(c.y / 500.0f + y, y, y - c.z / 200.0f));
}

/// CIE L*a*b* whose chroma fades with lightness (the Hunt effect).
vec3 toHuntLab(const vec3& linear) {
  constexpr float kDelta = 6.0f / 29.0f;
  const auto bend = [](float t) {
    return t > kDelta * kDelta * kDelta ? std::cbrt(t)
                                        : t / (3.0f * kDelta * kDelta) + 4.0f / 29.0f;
  };
  const vec3 xyz = kToXyz(linear);
  const float x = bend(xyz.x), y = bend(xyz.y), z = bend(xyz.z);
  const float lightness = 116.0f * y - 16.0f;
  return {lightness, 0.01f * lightness * 500.0f * (x - y), 0.01f * lightness * 200.0f * (y - z)};
}

/// The HyAB distance, to the power of kColorExponent.
float colorDistance(const vec3& a, const vec3& b) {
  const vec3 d = a - b;
  return std::pow(std::abs(d.x) + std::hypot(d.y, d.z), kColorExponent);
}

/// Small differences take most of the range; those beyond the knee share the rest.
float redistribute(float distance) {
  static const float largest = colorDistance(toHuntLab(vec3(0, 1, 0)), toHuntLab(vec3(0, 0, 1)));
  const float knee = kKneeInput * largest;
  if (distance < knee) return kKneeOutput / knee * distance;
  return kKneeOutput + (distance - knee) / (largest - knee) * (1.0f - kKneeOutput);
}

Kernel sampled(int radius, const std::function<double(double)>& f) {
  Kernel kernel;
  for (int i = -radius; i <= radius; ++i) kernel.push_back(static_cast<float>(f(i)));
  return kernel;
}

/// The two Gaussians of a sensitivity as separable kernels; together they sum to 1 in 2D.
std::vector<Kernel> sensitivityKernels(const Sensitivity& s, double pixelsPerDegree) {
  constexpr double kPi2 = std::numbers::pi * std::numbers::pi;
  const int radius =
      static_cast<int>(std::ceil(3.0 * std::sqrt(kWidestB / (2.0 * kPi2)) * pixelsPerDegree));
  std::vector<Kernel> kernels;
  double total = 0.0;
  for (const auto& gaussian : {std::pair{s.a1, s.b1}, {s.a2, s.b2}}) {
    const double a = gaussian.first, b = gaussian.second;
    if (a == 0.0) continue;
    const double height = std::sqrt(a * std::sqrt(std::numbers::pi / b));
    kernels.push_back(sampled(radius, [&](double i) {
      const double x = i / pixelsPerDegree;
      return height * std::exp(-kPi2 * x * x / b);
    }));
    const double sum = std::accumulate(kernels.back().begin(), kernels.back().end(), 0.0);
    total += sum * sum;
  }
  for (Kernel& kernel : kernels) {
    for (float& tap : kernel) tap /= static_cast<float>(std::sqrt(total));
  }
  return kernels;
}

/// Divides positive taps by their sum and negative ones by theirs.
Kernel balanced(Kernel kernel) {
  double positive = 0.0, negative = 0.0;
  for (float tap : kernel) (tap > 0.0f ? positive : negative) += std::abs(double{tap});
  for (float& tap : kernel) {
    const double sum = tap > 0.0f ? positive : negative;
    if (sum > 0.0) tap = static_cast<float>(tap / sum);
  }
  return kernel;
}

/// Blurs across a feature and, along it, the first derivative (edges) and the second (points).
struct FeatureKernels {
  Kernel blur, edge, point;
  explicit FeatureKernels(double pixelsPerDegree) {
    const double sigma = 0.5 * kFeatureWidth * pixelsPerDegree;
    const int radius = static_cast<int>(std::ceil(3.0 * sigma));
    const auto gauss = [&](double x) { return std::exp(-x * x / (2.0 * sigma * sigma)); };
    blur = balanced(sampled(radius, gauss));
    edge = balanced(sampled(radius, [&](double x) { return -x * gauss(x); }));
    point = balanced(
        sampled(radius, [&](double x) { return (x * x / (sigma * sigma) - 1.0) * gauss(x); }));
  }
};

struct Features {
  Plane edgeX, edgeY, pointX, pointY;
};

Features featuresOf(const Plane& luminance, const FeatureKernels& k) {
  const Plane blurred = filterRows(luminance, k.blur);
  return {filterColumns(filterRows(luminance, k.edge), k.blur), filterColumns(blurred, k.edge),
          filterColumns(filterRows(luminance, k.point), k.blur), filterColumns(blurred, k.point)};
}

/// What a viewer sees of one of the pictures.
struct Percept {
  std::vector<vec3> colors;  ///< filtered by contrast sensitivity, in Hunt-adjusted L*a*b*
  Features features;
};

Plane filtered(const Plane& plane, const std::vector<Kernel>& kernels) {
  Plane sum = filterColumns(filterRows(plane, kernels[0]), kernels[0]);
  for (std::size_t k = 1; k < kernels.size(); ++k) {
    const Plane more = filterColumns(filterRows(plane, kernels[k]), kernels[k]);
    for (std::size_t i = 0; i < sum.values.size(); ++i) sum.values[i] += more.values[i];
  }
  return sum;
}

vec3 clamped(const vec3& v) { return glm::clamp(v, vec3(0.0f), vec3(1.0f)); }

Percept perceive(const ColorImage& image, double pixelsPerDegree) {
  const std::size_t count = image.pixels.size();
  Plane channels[3], luminance(image.width, image.height);
  for (Plane& plane : channels) plane = Plane(image.width, image.height);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    const vec3 c = toYCxCz(clamped(image.pixels[i]));
    for (int k = 0; k < 3; ++k) channels[k].values[i] = c[k];
    luminance.values[i] = (c.x + 16.0f) / 116.0f;
  });
  const Sensitivity sensitivities[] = {kAchromatic, kRedGreen, kBlueYellow};
  for (int k = 0; k < 3; ++k) {
    channels[k] = filtered(channels[k], sensitivityKernels(sensitivities[k], pixelsPerDegree));
  }
  Percept out{std::vector<vec3>(count), featuresOf(luminance, FeatureKernels(pixelsPerDegree))};
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    const vec3 c(channels[0].values[i], channels[1].values[i], channels[2].values[i]);
    out.colors[i] = toHuntLab(clamped(fromYCxCz(c)));
  });
  return out;
}

float featureError(const Features& a, const Features& b, std::size_t i) {
  const auto length = [i](const Plane& x, const Plane& y) {
    return std::hypot(x.values[i], y.values[i]);
  };
  const float edge = std::abs(length(a.edgeX, a.edgeY) - length(b.edgeX, b.edgeY));
  const float point = std::abs(length(a.pointX, a.pointY) - length(b.pointX, b.pointY));
  return std::pow(std::max(edge, point) / std::numbers::sqrt2_v<float>, kFeatureExponent);
}

/// x where the ACES fit (a x^2 + b x + c) / (d x^2 + e x + f) [Narkowicz 2016], with its exposure
/// of 0.6 folded in, reaches `target`.
constexpr double kAces[] = {0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14};
double acesReaches(double target) {
  const double a = kAces[0] - target * kAces[3], b = kAces[1] - target * kAces[4],
               c = kAces[2] - target * kAces[5];
  return (-b + std::sqrt(b * b - 4.0 * a * c)) / (2.0 * a);
}

ColorImage toneMapped(const ColorImage& image, float stops) {
  ColorImage out = image;
  const float scale = std::exp2(stops);
  tbb::parallel_for(std::size_t{0}, out.pixels.size(), [&](std::size_t i) {
    // The curve is flat long before the limit, which keeps its squares finite.
    const vec3 x = glm::clamp(out.pixels[i] * scale, vec3(0.0f), vec3(1e9f));
    const auto k = [](int j) { return static_cast<float>(kAces[j]); };
    out.pixels[i] = clamped((x * (k(0) * x + k(1)) + k(2)) / (x * (k(3) * x + k(4)) + k(5)));
  });
  return out;
}

}  // namespace

std::vector<float> flipMap(const ColorImage& reference, const ColorImage& test,
                           double pixelsPerDegree) {
  assert(reference.pixels.size() == test.pixels.size() && !test.pixels.empty());
  assert(pixelsPerDegree >= kLeastPixelsPerDegree && pixelsPerDegree <= kMostPixelsPerDegree);
  const Percept a = perceive(reference, pixelsPerDegree), b = perceive(test, pixelsPerDegree);
  std::vector<float> map(reference.pixels.size());
  tbb::parallel_for(std::size_t{0}, map.size(), [&](std::size_t i) {
    const float color = redistribute(colorDistance(a.colors[i], b.colors[i]));
    map[i] = std::pow(color, 1.0f - std::min(featureError(a.features, b.features, i), 1.0f));
  });
  return map;
}

ExposureRange flipExposures(const ColorImage& reference) {
  constexpr float kLeast = std::numeric_limits<float>::epsilon();
  std::vector<float> luminances;
  luminances.reserve(reference.pixels.size());
  for (const vec3& c : reference.pixels) luminances.push_back(luminance(glm::max(c, vec3(0.0f))));
  const auto middle = luminances.begin() + static_cast<std::ptrdiff_t>(luminances.size() / 2);
  std::nth_element(luminances.begin(), middle, luminances.end());
  const float median = std::max(*middle, kLeast);
  const float largest = std::max(*std::max_element(middle, luminances.end()), kLeast);
  const auto x = static_cast<float>(acesReaches(0.85));
  ExposureRange range{std::log2(x / largest), std::log2(x / median), 2};
  range.count = std::max(2, static_cast<int>(std::ceil(range.stop - range.start)));
  return range;
}

std::vector<float> hdrFlipMap(const ColorImage& reference, const ColorImage& test,
                              double pixelsPerDegree) {
  const ExposureRange range = flipExposures(reference);
  std::vector<float> map(reference.pixels.size(), 0.0f);
  for (int i = 0; i < range.count; ++i) {
    const float stops = range.start + (range.stop - range.start) * static_cast<float>(i) /
                                          static_cast<float>(range.count - 1);
    const std::vector<float> one =
        flipMap(toneMapped(reference, stops), toneMapped(test, stops), pixelsPerDegree);
    for (std::size_t p = 0; p < map.size(); ++p) map[p] = std::max(map[p], one[p]);
  }
  return map;
}

double meanError(const std::vector<float>& map) {
  if (map.empty()) return 0.0;
  return std::accumulate(map.begin(), map.end(), 0.0) / static_cast<double>(map.size());
}

}  // namespace trex
