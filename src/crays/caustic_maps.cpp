#include <algorithm>
#include <bit>
#include <cmath>

#include "src/core/clock.h"
#include "src/crays/caustics.h"

namespace trex {
namespace {

// Photons a sample: a quarter of the pixels; of a map.
constexpr std::uint64_t kFewestCaustics = 1u << 11, kMostCaustics = 1u << 15;
constexpr std::uint64_t kLargestMap = 1u << 17;
constexpr std::size_t kKeptMaps = 4;
constexpr double kShrink = 2.0 / 3.0;  // alpha of [Knaus and Zwicker 2011]
constexpr std::uint32_t kOfWidths = 0xffffffffu, kWidthPhotons = 1u << 14;  // no map's
constexpr double kInWidth = 6.0, kLeastInWidth = 6.0;  // photons of the first map

}  // namespace

bool CausticMaps::needed(const Scene& scene) {
  const bool bends = std::any_of(scene.materials.begin(), scene.materials.end(), mayBend);
  const bool lit = std::any_of(scene.lights.begin(), scene.lights.end(),
                               [](const Light& l) { return maxComponent(l.intensity) > 0.0f; });
  return bends && lit;
}

CausticMaps::Plan CausticMaps::plan(std::uint32_t sample) const {
  const auto each =
      static_cast<std::uint32_t>(std::clamp(pixels_ / 4, kFewestCaustics, kMostCaustics));
  const auto most = std::bit_floor(static_cast<std::uint32_t>(kLargestMap / each));
  const auto map = static_cast<std::uint32_t>(std::bit_width(sample));
  const std::uint32_t samples = sample == 0 ? 1 : std::bit_floor(sample);
  if (samples <= most) return {map, each * samples, sample == 0 ? 1 : 2 * samples};
  const std::uint32_t later = (sample - 2 * most) / most;
  return {static_cast<std::uint32_t>(std::bit_width(most)) + 1 + later, each * most,
          2 * most + (later + 1) * most};
}

void CausticMaps::start() {
  lights_ = std::make_unique<const CausticLights>(scene_, rays_, seed_);
  const auto photons = lights_->shoot(kOfWidths, kWidthPhotons);
  shot_ += kWidthPhotons;
  const double share = static_cast<double>(kWidthPhotons) / plan(0).photons;
  widths_ = std::make_unique<const CausticWidths>(photons, lights_->sceneRadius(),
                                                  std::max(kInWidth * share, kLeastInWidth));
}

std::unique_ptr<const CausticMap> CausticMaps::make(const Plan& plan) {
  auto photons = lights_->shoot(plan.map, plan.photons);
  for (CausticPhoton& p : photons) p.power /= static_cast<float>(plan.photons);
  shot_ += plan.photons;
  // r_{s+1}^2 = r_s^2 (s + alpha) / (s + 1), in closed form.
  const double s = plan.lastSample;
  const double square =
      std::exp(std::lgamma(s + kShrink) - std::lgamma(1.0 + kShrink) - std::lgamma(s + 1.0));
  return std::make_unique<const CausticMap>(photons, *widths_,
                                            static_cast<float>(std::sqrt(square)));
}

void CausticMaps::prepare(std::span<const std::uint32_t> samples) {
  std::vector<Plan> wanted;
  for (const std::uint32_t sample : samples) {
    const Plan p = plan(sample);
    const auto same = [&](const auto& other) { return other.map == p.map; };
    if (std::none_of(wanted.begin(), wanted.end(), same)) wanted.push_back(p);
  }
  const auto isWanted = [&](const Kept& kept) {
    return std::any_of(wanted.begin(), wanted.end(),
                       [&](const Plan& p) { return p.map == kept.map; });
  };
  for (const Plan& p : wanted) {
    if (std::any_of(maps_.begin(), maps_.end(), [&](const Kept& k) { return k.map == p.map; })) {
      continue;
    }
    const double mark = secondsNow();
    if (!lights_) start();
    if (!lights_->any()) return;
    if (maps_.size() >= kKeptMaps) {
      const auto old = std::find_if_not(maps_.begin(), maps_.end(), isWanted);
      if (old != maps_.end()) maps_.erase(old);
    }
    maps_.push_back({p.map, make(p)});
    seconds_ += secondsNow() - mark;
  }
}

const CausticMap* CausticMaps::find(std::uint32_t sample) const {
  const std::uint32_t map = plan(sample).map;
  for (const Kept& kept : maps_) {
    if (kept.map == map) return kept.photons.get();
  }
  return nullptr;
}

}  // namespace trex
