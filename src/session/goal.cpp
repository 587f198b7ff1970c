#include "src/session/goal.h"

#include <algorithm>
#include <vector>

#include "src/core/clock.h"
#include "src/frame/denoise.h"

namespace trex {
namespace {

constexpr std::uint32_t kFirstLook = 16;

/// Seconds a pixel that the filter takes here, at most: every neighbour counts on an even picture.
double filterSeconds() {
  constexpr std::uint32_t kSide = 64;
  FeatureImage features(kSide, kSide);
  const std::vector<vec3> even(kSide * kSide, vec3(1.0f));
  double best = kInfinity;
  for (int run = 0; run < 2; ++run) {
    const double mark = secondsNow();
    denoiseGuess(features, even, even);
    best = std::min(best, secondsNow() - mark);
  }
  return best / (kSide * kSide);
}

}  // namespace

Goal::Goal(const RenderSettings& s)
    : samples_(s.samples), seconds_(s.seconds), error_(s.error), nextLook_(kFirstLook) {
  if (!s.denoise || !(s.seconds > 0.0)) return;
  const double filters = s.exact > 0.0 ? 2.0 : 1.0;
  const double taken = filters * filterSeconds() * s.width * s.height;
  seconds_ = std::max(s.seconds - taken, 0.1 * s.seconds);
}

bool Goal::reached(std::uint32_t samples, double seconds) const {
  const bool enough = samples_ > 0 && samples >= samples_;
  return enough || (error_ > 0.0 && estimate_ <= error_) || late(samples, seconds);
}

bool Goal::late(std::uint32_t samples, double seconds) const {
  return seconds_ > 0.0 && samples > 0 && seconds >= seconds_;
}

double Goal::progress(double samples, double seconds) const {
  double done = samples_ > 0 ? samples / samples_ : 0.0;
  if (seconds_ > 0.0) done = std::max(done, seconds / seconds_);
  if (error_ > 0.0) done = std::max(done, error_ / estimate_);
  return std::min(done, 1.0);
}

void Goal::look(const Accumulator& sums, std::uint32_t samples) {
  if (!(error_ > 0.0) || samples < nextLook_) return;
  estimate_ = sums.estimatedError();
  nextLook_ = samples + std::max(samples / 8u, 1u);
}

void Goal::restart() { restore(kFirstLook, kInfinity); }

}  // namespace trex
