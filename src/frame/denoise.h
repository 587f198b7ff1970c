// The guess and its correction, denoised: an edge-avoiding filter whose width follows the estimated
// variance, so that it fades to nothing as samples grow. Never used on an exact picture.
//
// An a-trous wavelet filter [Dammertz et al., HPG 2010] with variance-guided weights in the manner
// of [Schied et al., HPG 2017], on radiance divided by albedo. Such weights take rare bright
// samples for what they are not and lose their light, so what the filter took is given back: spread
// widely over pixels that show the same surface, whatever their light, none of it lost. A pixel
// that shows two surfaces is filtered as two: so rims stay sharp, and are as free of noise as what
// they part. What the correction estimates, the bias of a cached guess, varies slowly over
// surfaces: filtering it apart from the guess keeps the guess's detail, and adding only as much of
// it as stands out of its noise lowers the error [Gu, Iglesias-Guitian, Moon, SIGGRAPH Asia 2022].
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "src/frame/features.h"

namespace trex {

/// One filter under way. The result has the same bits on every instruction set, for any number of
/// threads, and wherever it was interrupted. One thread at a time may call; the work is done in its
/// oneTBB arena.
class GuessFilter {
 public:
  /// Of the light in `features`, each part of a pixel by what it shows. `few`: so few samples that
  /// their own spread tells little; the filter then looks at that around each pixel. Copies what it
  /// needs.
  GuessFilter(const FeatureImage& features, bool few);
  /// Of other light, by the surface() of each pixel. `radiance` and `variance` (of each pixel's
  /// mean, not negative) go row by row, width * height of the features; non-finite input must not
  /// occur. What the two functions below do apart from each other is told by `correction`.
  GuessFilter(const FeatureImage& features, const std::vector<vec3>& radiance,
              const std::vector<vec3>& variance, bool correction);
  GuessFilter(GuessFilter&& other) noexcept;
  GuessFilter& operator=(GuessFilter&& other) noexcept;
  ~GuessFilter();

  /// Works until all is done or keepGoing() says no, which is asked from the calling thread after
  /// about every millisecond of work: each call comes nearer to the end. True once all is done.
  bool advance(const std::function<bool()>& keepGoing);

  /// The filtered picture, row by row. Once, after advance() has returned true.
  std::vector<vec3> result();

  /// Of one filter, with its result, if every pixel shows two surfaces.
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

/// Filters `radiance` in one go. The sum of the result's luminance is that of `radiance` but for
/// differences of the colour of albedos; no value is negative.
std::vector<vec3> denoiseGuess(const FeatureImage& features, const std::vector<vec3>& radiance,
                               const std::vector<vec3>& variance);

/// Filters the mean difference between exact paths and guess alike, then scales each pixel's result
/// d, with v its variance after the filter, by d^2 / (d^2 + 4 v). Values may be negative.
std::vector<vec3> denoiseCorrection(const FeatureImage& features,
                                    const std::vector<vec3>& difference,
                                    const std::vector<vec3>& variance);

}  // namespace trex
