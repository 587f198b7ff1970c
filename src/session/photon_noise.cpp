#include "src/session/photon_noise.h"

#include <algorithm>

#include "src/crays/photon_lots.h"
#include "src/session/block_products.h"

namespace trex {
namespace {

constexpr std::uint32_t kFirstEstimate = 16;  // samples: before that nobody asks

}  // namespace

std::uint64_t photonsBefore(std::span<const SampleLight> lights, std::uint64_t photons) {
  std::uint64_t before = 0;
  for (const SampleLight& light : lights) {
    if (light.photons < photons) before = light.photons;
  }
  const bool alone = lights.size() < 2 || lights[1].first >= kFirstEstimate;
  return before == 0 && alone ? photons / 2 : before;
}

double varianceOfLight(std::span<const SampleLight> lights, std::uint32_t samples) {
  // Two lights have in common the noise of the one with more photons.
  double sum = 0.0, earlier = 0.0;
  for (std::size_t i = 0; i < lights.size() && lights[i].first < samples; ++i) {
    const std::uint32_t end = i + 1 < lights.size() ? lights[i + 1].first : samples;
    const double own = static_cast<double>(std::min(end, samples) - lights[i].first);
    sum += own * (own + 2.0 * earlier) / static_cast<double>(lights[i].photons);
    earlier += own;
  }
  return earlier > 0.0 ? sum / (earlier * earlier) : 0.0;
}

void PhotonNoise::add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& noise) {
  const auto begins = [&](const SampleLight& light) { return light.first == sample; };
  if (std::any_of(lights_.begin(), lights_.end(), begins)) restart(x, y);
  if (!isFinite(noise)) return;
  Pixel& pixel = pixels_[std::size_t{y} * width_ + x];
  pixel.sum += noise;
  pixel.count += 1.0f;
}

double PhotonNoise::square(std::uint32_t samples, std::span<const vec3> weigh,
                           std::uint32_t side) const {
  const auto after = std::find_if(lights_.begin() + 1, lights_.end(),
                                  [&](const SampleLight& light) { return light.first >= samples; });
  const double photons = static_cast<double>((after - 1)->photons);
  const auto height = static_cast<std::uint32_t>(pixels_.size() / width_);
  const auto mean = [&](std::size_t i) { return pixels_[i].mean(); };
  const double all =
      blockProducts<PhotonLots::kLots>(width_, height, side, weigh, mean, PhotonLots::ofPixel)
          .square;
  const double older = varianceOfLight(lights_, samples) * photons;
  return std::max(all, 0.0) * older / (3.0 * static_cast<double>(pixels_.size()));
}

}  // namespace trex
