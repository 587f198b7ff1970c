#include <algorithm>
#include <cmath>

#include "src/core/clock.h"
#include "src/paths/caustics.h"

namespace trex {
namespace {

// Photons of a map: a quarter of the pixels. Of all maps that are kept.
constexpr std::uint64_t kFewestCaustics = 1u << 11, kMostCaustics = 1u << 15;
constexpr std::uint64_t kKept = 1u << 19;
constexpr std::uint32_t kSparser = 4;                          // maps of later vertices
constexpr double kShrink = 2.0 / 3.0;                          // alpha of [Knaus and Zwicker 2011]
constexpr std::uint32_t kSeen = 0, kLater = 1, kOfWidths = 2;  // sets of photons
constexpr std::uint32_t kWidthPhotons = 1u << 14;
constexpr double kInWidth = 6.0, kLeastInWidth = 6.0;  // photons of the first map

}  // namespace

bool CausticMaps::needed(const Scene& scene) {
  const bool bends = std::any_of(scene.materials.begin(), scene.materials.end(), mayBend);
  const bool lit = std::any_of(scene.lights.begin(), scene.lights.end(),
                               [](const Light& l) { return maxComponent(l.intensity) > 0.0f; });
  return bends && lit;
}

std::uint32_t CausticMaps::photonsOfMap() const {
  return static_cast<std::uint32_t>(std::clamp(pixels_ / 4, kFewestCaustics, kMostCaustics));
}

void CausticMaps::start() {
  lights_ = std::make_unique<const CausticLights>(scene_, walks_, seed_);
  const auto photons = lights_->shoot(kOfWidths, 0, kWidthPhotons);
  shot_ += kWidthPhotons;
  const double share = static_cast<double>(kWidthPhotons) / photonsOfMap();
  widths_ = std::make_unique<const CausticWidths>(photons, lights_->sceneRadius(),
                                                  std::max(kInWidth * share, kLeastInWidth));
}

SampleCaustics CausticMaps::make(std::uint32_t sample) {
  // r_{s+1}^2 = r_s^2 (s + alpha) / (s + 1), in closed form.
  const double s = sample + 1.0;
  const double square =
      std::exp(std::lgamma(s + kShrink) - std::lgamma(1.0 + kShrink) - std::lgamma(s + 1.0));
  const auto map = [&](std::uint32_t set, std::uint32_t count) {
    auto photons = lights_->shoot(set, std::uint64_t{sample} * count, count);
    for (CausticPhoton& p : photons) p.power /= static_cast<float>(count);
    shot_ += count;
    return std::make_unique<const CausticMap>(scene_, photons, *widths_,
                                              static_cast<float>(std::sqrt(square)), walks_);
  };
  return {sample, map(kSeen, photonsOfMap()), map(kLater, photonsOfMap() / kSparser)};
}

void CausticMaps::prepare(std::span<const std::uint32_t> samples) {
  const std::size_t most = std::max<std::size_t>(kKept / photonsOfMap(), samples.size());
  for (const std::uint32_t sample : samples) {
    if (find(sample) != nullptr) continue;
    const double mark = secondsNow();
    if (!lights_) start();
    if (!lights_->any()) return;
    if (maps_.size() >= most) {
      const auto isWanted = [&](const SampleCaustics& kept) {
        return std::find(samples.begin(), samples.end(), kept.sample) != samples.end();
      };
      maps_.erase(std::find_if_not(maps_.begin(), maps_.end(), isWanted));
    }
    maps_.push_back(make(sample));
    seconds_ += secondsNow() - mark;
  }
}

const SampleCaustics* CausticMaps::find(std::uint32_t sample) const {
  const auto at = std::find_if(maps_.begin(), maps_.end(),
                               [&](const SampleCaustics& kept) { return kept.sample == sample; });
  return at == maps_.end() ? nullptr : &*at;
}

}  // namespace trex
