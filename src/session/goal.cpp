#include "src/session/goal.h"

#include <algorithm>

namespace trex {
namespace {

constexpr std::uint32_t kFirstLook = 16;

}  // namespace

Goal::Goal(const RenderSettings& s)
    : samples_(s.samples),
      seconds_(s.seconds),
      error_(s.error),
      part_(s.dial ? 3 : 8),
      nextLook_(kFirstLook) {}

double Goal::secondsOfSamples() const { return std::max(seconds_ - afterwards_, 0.1 * seconds_); }

bool Goal::reached(std::uint32_t samples, double seconds) const {
  const bool enough = samples_ > 0 && samples >= samples_;
  return enough || (error_ > 0.0 && estimate_ <= error_) || late(samples, seconds);
}

bool Goal::late(std::uint32_t samples, double seconds) const {
  return seconds_ > 0.0 && samples > 0 && seconds >= secondsOfSamples();
}

double Goal::progress(double samples, double seconds) const {
  double done = samples_ > 0 ? samples / samples_ : 0.0;
  if (seconds_ > 0.0) done = std::max(done, seconds / secondsOfSamples());
  if (error_ > 0.0) done = std::max(done, error_ / estimate_);
  return std::min(done, 1.0);
}

bool Goal::wantsLook(std::uint32_t samples) const { return error_ > 0.0 && samples >= nextLook_; }

void Goal::look(std::uint32_t samples, double error) {
  estimate_ = error;
  nextLook_ = samples + std::max(samples / part_, 1u);
}

void Goal::restart() { restore(kFirstLook, kInfinity); }

}  // namespace trex
