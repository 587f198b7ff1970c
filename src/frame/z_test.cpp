#include "src/frame/z_test.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "src/frame/picture_reader.h"

namespace trex {
namespace {

constexpr const char* kColors[] = {"R", "G", "B"};

/// Of a normal distribution, both sides.
double pValue(double z) { return std::erfc(std::abs(z) / std::numbers::sqrt2); }

/// Chance that the least of `count` p-values is at most p.
double corrected(double p, double count) {
  return p >= 1.0 ? 1.0 : -std::expm1(count * std::log1p(-p));
}

double ratio(double difference, double variance) {
  if (difference == 0.0) return 0.0;
  if (variance > 0.0) return difference / std::sqrt(variance);
  return std::copysign(std::numeric_limits<double>::infinity(), difference);
}

struct ChannelOf {
  const Picture& picture;
  int value, variance;
  ChannelOf(const Picture& p, const char* color)
      : picture(p),
        value(channelIndex(p, color)),
        variance(channelIndex(p, std::string("variance.") + color)) {}
  double at(std::size_t pixel, int channel) const {
    return double{picture.values[pixel * picture.channels.size() + channel]};
  }
};

}  // namespace

bool hasVariance(const Picture& picture) {
  return std::all_of(std::begin(kColors), std::end(kColors), [&](const char* color) {
    return channelIndex(picture, color) >= 0 &&
           channelIndex(picture, std::string("variance.") + color) >= 0;
  });
}

ZTest zTest(const Picture& a, const Picture& b) {
  ZTest out;
  const std::size_t pixels = std::size_t{a.width} * a.height;
  std::uint64_t within[3] = {0, 0, 0};
  for (std::size_t c = 0; c < 3; ++c) {
    const ChannelOf ca(a, kColors[c]), cb(b, kColors[c]);
    double difference = 0.0, variance = 0.0;
    for (std::size_t i = 0; i < pixels; ++i) {
      const double d = ca.at(i, ca.value) - cb.at(i, cb.value);
      const double v = std::max(ca.at(i, ca.variance), 0.0) + std::max(cb.at(i, cb.variance), 0.0);
      difference += d;
      variance += v;
      const double z = std::abs(ratio(d, v));
      for (int k = 0; k < 3; ++k) within[k] += z < k + 2.0 ? 1u : 0u;
      if (z <= out.largest) continue;
      out.largest = z;
      out.largestX = static_cast<std::uint32_t>(i % a.width);
      out.largestY = static_cast<std::uint32_t>(i / a.width);
    }
    out.meanZ[c] = ratio(difference, variance);
    out.meanP[c] = pValue(out.meanZ[c]);
  }
  const double count = 3.0 * static_cast<double>(pixels);
  out.within2 = static_cast<double>(within[0]) / count;
  out.within3 = static_cast<double>(within[1]) / count;
  out.within4 = static_cast<double>(within[2]) / count;
  out.largestP = corrected(pValue(out.largest), count);
  out.leastMeanP = corrected(*std::min_element(out.meanP.begin(), out.meanP.end()), 3.0);
  return out;
}

}  // namespace trex
