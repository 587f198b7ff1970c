#include "src/session/picture_error.h"

#include <algorithm>

namespace trex {
namespace {

constexpr std::uint32_t kSamplesThatTell = 4;
/// Part of its noise by which light is changed: small against what the filter tells apart.
constexpr float kChange = 0.25f;
/// Pixels of a block each way, in which what a filter leaves of photons' noise counts as even.
constexpr std::uint32_t kEven = 4;
/// Of the true error over what is seen of it: detail within two pixels that the filter blurs, or
/// that the guess has wrong, is not. Found on interiors (docs/auto.md).
constexpr double kUnseen = 1.7;

double sumOf(const vec3& v) { return static_cast<double>(v.x + v.y + v.z); }

/// Another draw of a pixel's noise.
vec3 noiseOf(const FrameBuffers& frame, std::uint32_t x, std::uint32_t y) {
  const auto count = static_cast<float>(frame.sums.guess(x, y).count());
  return frame.lightNoise->draw(x, y, frame.features->light(x, y), count);
}

}  // namespace

double estimatePictureError(const FrameBuffers& frame) {
  const std::uint32_t width = frame.sums.width(), height = frame.sums.height();
  if (frame.tiles.samplesDone() < kSamplesThatTell) return kInfinity;
  ShownOptions options{.method = DenoiseMethod::kFilter, .pairs = true};
  options.keepGuess = true;
  ShownPicture shown(frame, width, height, options);
  shown.advance([] { return true; });
  if (!shown.biasLeft()) return kInfinity;
  const std::vector<vec3> picture = shown.take(), weigh = relativeWeights(picture);
  const std::vector<vec3>& light = shown.guessLight();

  FeatureImage changed = *frame.features;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      changed.addLight(x, y, kChange * noiseOf(frame, x, y));
    }
  }
  const std::vector<vec3> other = denoiseFrame(frame, changed, options.method);
  // Of the filtered light: how far its input's noise moves it; what it leaves of its input, and
  // what neighbours have in common of that. All in units of relMSE.
  std::vector<vec3> left(light.size());
  double moved = 0.0, told = 0.0, own = 0.0, square = 0.0, common = 0.0, neighbours = 0.0;
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      const std::size_t i = std::size_t{y} * width + x;
      const vec3 noise = noiseOf(frame, x, y), step = (other[i] - light[i]) / kChange;
      left[i] = (frame.features->light(x, y) - light[i]) * glm::sqrt(weigh[i]);
      moved += sumOf(weigh[i] * step * step);
      told += sumOf(weigh[i] * noise * noise);
      own += sumOf(weigh[i] * noise * step);
      square += sumOf(left[i] * left[i]);
      if (x > 0) common += sumOf(left[i] * left[i - 1]);
      if (y > 0) common += sumOf(left[i] * left[i - width]);
      neighbours += (x > 0 ? 1.0 : 0.0) + (y > 0 ? 1.0 : 0.0);
    }
  }
  const double pixels = static_cast<double>(light.size());
  // Stratified samples have less noise than their spread tells. Of the noise that there is the
  // filter takes all but a part from each pixel, and puts that of others in.
  const double taken = told - 2.0 * own + moved;
  const double noise = taken > 0.0 ? std::min(square / taken, 1.0) * moved / pixels : 0.0;
  const double shared = neighbours > 0.0 ? common / neighbours + 2.0 * noise : 0.0;
  const double photons = frame.photonNoise->square(frame.tiles.samplesDone(), weigh, kEven);
  const double filtered = kUnseen * std::max(shared, noise) / 3.0;
  return filtered + shown.biasLeft()->square(photons, filtered);
}

}  // namespace trex
