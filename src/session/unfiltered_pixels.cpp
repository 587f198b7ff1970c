#include "src/session/unfiltered_pixels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "src/session/measured_correction.h"

namespace trex {
namespace {

constexpr double kDark = 0.01;                // of squares in relMSE
constexpr std::uint32_t kEvenUnfiltered = 2;  // pixels each way, in which photons' noise is alike

double overChannels(const dvec3& v) { return v.x + v.y + v.z; }

}  // namespace

void UnfilteredPixels::Squares::add(const Squares& o) {
  all += o.all;
  noise += o.noise;
  doubt += o.doubt;
}

/// A James-Stein combiner: the guess is its shrinkage target.
double UnfilteredPixels::Squares::weight() const {
  const double sure = all - noise - kSurely * std::sqrt(doubt);
  return sure > 0.0 ? sure / all : 0.0;
}

UnfilteredPixels::UnfilteredPixels(const FrameBuffers& frame)
    : frame_(frame),
      parts_(frame.sums.width(), frame.sums.height()),
      known_(frame.tiles.tiles().size()) {
  if (!frame.dial || frame.tiles.samplesDone() == 0) return;
  tbb::parallel_for(std::size_t{0}, known_.size(), [&](std::size_t i) { measure(i); });
  parts_.settle();
}

/// Whether a tile has pairs enough, and what the sums of its cells, which are no other tile's, are
/// then.
void UnfilteredPixels::measure(std::size_t tile) {
  const Tile& area = frame_.tiles.tiles()[tile];
  const auto each = [&](const auto& visit) {
    for (std::uint32_t y = area.y; y < area.y + area.height; ++y) {
      for (std::uint32_t x = area.x; x < area.x + area.width; ++x) visit(x, y);
    }
  };
  std::uint64_t fewest = ~std::uint64_t{0};
  dvec3 mean(0.0), variance(0.0);
  each([&](std::uint32_t x, std::uint32_t y) {
    const Moments d = frame_.sums.difference(x, y);
    fewest = std::min(fewest, d.count());
    variance += d.varianceOfMean() * static_cast<double>(d.count());
    mean += frame_.sums.guess(x, y).mean();
  });
  if (fewest < kPairsEnough) return;
  const double pixels = double{1} * area.width * area.height;
  known_[tile] = {true, variance / pixels};
  mean /= pixels;
  const dvec3 weigh = 1.0 / (mean * mean + kDark * overChannels(mean * mean) / 3.0 + 1e-30);
  each([&](std::uint32_t x, std::uint32_t y) {
    const dvec3 d = frame_.sums.difference(x, y).mean(), v = weigh * differenceVariance(x, y);
    parts_.of(x, y).add({overChannels(weigh * d * d), overChannels(v), 2.0 * overChannels(v * v)});
  });
}

/// A rare bright path makes both mean and variance of its pixel large; a pixel that has met none
/// knows too little. So its tile's differences say what the variance of one is at least.
dvec3 UnfilteredPixels::differenceVariance(std::uint32_t x, std::uint32_t y) const {
  const Moments d = frame_.sums.difference(x, y);
  return glm::max(d.varianceOfMean(),
                  known_[frame_.tiles.tileAt(x, y)].variance / static_cast<double>(d.count()));
}

/// Of a pixel's differences, what is added.
double UnfilteredPixels::part(std::uint32_t x, std::uint32_t y) const {
  return known_[frame_.tiles.tileAt(x, y)].enough ? static_cast<double>(parts_.at(x, y)) : 0.0;
}

dvec3 UnfilteredPixels::mean(std::uint32_t x, std::uint32_t y) const {
  if (!frame_.dial) return frame_.sums.mean(x, y);
  return frame_.sums.guess(x, y).mean() + part(x, y) * frame_.sums.difference(x, y).mean();
}

dvec3 UnfilteredPixels::variance(std::uint32_t x, std::uint32_t y) const {
  const dvec3 all = frame_.sums.varianceOfMean(x, y);
  if (!frame_.dial) return all;
  const double p = part(x, y);
  const dvec3 guess = frame_.sums.guess(x, y).varianceOfMean();
  const dvec3 own = frame_.sums.difference(x, y).varianceOfMean();
  return glm::max(guess + p * p * own + p * (all - guess - own), dvec3(0.0));
}

dvec3 UnfilteredPixels::direct(std::uint32_t x, std::uint32_t y) const {
  const dvec3 all = frame_.direct->mean(x, y);
  if (!frame_.dial) return all;
  const dvec3 guess = frame_.direct->guess(x, y);
  return guess + part(x, y) * (all - guess);
}

double UnfilteredPixels::estimatedError() const {
  const Accumulator& sums = frame_.sums;
  if (!frame_.dial) return sums.estimatedError();
  if (frame_.tiles.samplesDone() < 2) return kInfinity;
  const std::uint32_t width = sums.width(), height = sums.height();
  std::vector<vec3> picture(std::size_t{width} * height);
  for (std::size_t i = 0; i < picture.size(); ++i) {
    const auto x = static_cast<std::uint32_t>(i % width), y = static_cast<std::uint32_t>(i / width);
    picture[i] = vec3(mean(x, y));
  }
  const std::vector<vec3> weigh = relativeWeights(picture);
  std::vector<vec3> unknown = weigh;  // of pixels whose pairs do not tell yet
  double noise = 0.0, bias = 0.0;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    const auto x = static_cast<std::uint32_t>(i % width), y = static_cast<std::uint32_t>(i / width);
    const dvec3 w(weigh[i]);
    noise += overChannels(w * variance(x, y));
    if (!known_[frame_.tiles.tileAt(x, y)].enough) continue;
    unknown[i] = vec3(0.0f);
    const double left = 1.0 - part(x, y);
    const dvec3 d = sums.difference(x, y).mean();
    bias += left * left * overChannels(w * (d * d - sums.difference(x, y).varianceOfMean()));
  }
  const double photons = frame_.photonNoise ? frame_.photonNoise->square(frame_.tiles.samplesDone(),
                                                                         unknown, kEvenUnfiltered)
                                            : 0.0;
  return (noise + std::max(bias, 0.0)) / (3.0 * static_cast<double>(picture.size())) + photons;
}

}  // namespace trex
