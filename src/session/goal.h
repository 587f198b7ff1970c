// When a picture is done: the samples, the seconds or the error of its settings, whichever comes
// first. Without any of them: never.
#pragma once

#include <cstdint>

#include "src/core/maths.h"
#include "src/frame/accumulator.h"
#include "src/session/settings.h"

namespace trex {

class Goal {
 public:
  explicit Goal(const RenderSettings& settings);
  /// Of the seconds so many are kept free from now on, for the denoiser.
  void keepFree(double afterwards) { afterwards_ = afterwards; }

  /// `samples`: that every pixel has; `seconds` of rendering so far.
  bool reached(std::uint32_t samples, double seconds) const;
  /// The seconds are up, and every pixel has a sample: a picture has no holes.
  bool late(std::uint32_t samples, double seconds) const;
  /// Share that is done, [0, 1]. `samples`: mean of the pixels.
  double progress(double samples, double seconds) const;
  /// No pixel needs more; 0: no limit.
  std::uint32_t mostSamples() const { return samples_; }

  /// Whether the error is to be estimated: if it is a goal, each time an eighth more samples are
  /// there; with a dial, whose estimate takes longer, a third more.
  bool wantsLook(std::uint32_t samples) const;
  /// The estimate, relMSE; infinite if it can't be told.
  void look(std::uint32_t samples, double error);
  /// That of the noise in these sums, if one is wanted.
  void look(const Accumulator& sums, std::uint32_t samples) {
    if (wantsLook(samples)) look(samples, sums.estimatedError());
  }
  /// The picture begins anew.
  void restart();

  // What a checkpoint keeps.
  std::uint32_t nextLook() const { return nextLook_; }
  double estimate() const { return estimate_; }
  void restore(std::uint32_t nextLook, double estimate) {
    nextLook_ = nextLook;
    estimate_ = estimate;
  }

 private:
  double secondsOfSamples() const;

  std::uint32_t samples_;
  double seconds_, error_;
  double afterwards_ = 0.0;      ///< of the seconds, not for samples
  std::uint32_t part_;           ///< of the samples, that many more until the next look
  std::uint32_t nextLook_;       ///< samples at which the error is estimated next
  double estimate_ = kInfinity;  ///< relMSE, as of the last look
};

}  // namespace trex
