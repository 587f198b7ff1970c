// What a noisy picture of corrections adds to another: denoised, and as much of it as is true. What
// exact paths add to the guess; and what a denoiser that does not fade as samples grow took too
// much of it.
//
// The pixels are parted in two halves like the fields of a chessboard, and the corrections of each
// half are filtered. What a filtered half shares with the pixels of the other is bias; what it does
// not share is noise, of paths or of the filter's making. So the sum of their products over a
// region, divided by the sum of the filtered half's squares, is the share of it that lowers the
// error most: a James-Stein combiner [Gu, Iglesias-Guitian, Moon, SIGGRAPH Asia 2022] whose weight
// is measured on pixels that the filter has not seen [Batson, Royer 2019]. What is left of the bias
// is known likewise. (Halves of a pixel's samples would not do: they are stratified, so what one
// has too much the other has too little.)
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "src/frame/denoise.h"
#include "src/session/cell_weights.h"
#include "src/session/frame_buffers.h"

namespace trex {

/// Pixels row by row: means, and the variances of these means.
struct NoisyPixels {
  std::vector<vec3> mean, variance;
};

/// Of a pixel, from which on they tell their own variance.
inline constexpr std::uint64_t kPairsEnough = 2;

/// The differences between exact paths and guess.
NoisyPixels exactDifferences(const FrameBuffers& frame);

/// What the square of an error at each value of a picture weighs in relMSE.
std::vector<vec3> relativeWeights(const std::vector<vec3>& picture);

/// What is left of a guess's bias, in squares: what pairs say of it, and what is taken away.
struct BiasLeft {
  BiasFigures even;       ///< of the guess, even in blocks of 8 x 8 pixels
  double detail = 0.0;    ///< of smaller blocks, as far as it stands out
  double captured = 0.0;  ///< by the correction

  /// Estimated; `known` of the square of the bias, even in blocks, is known without pairs. What
  /// they say beyond that counts as far as it stands out of its standard error, and else no more
  /// than in proportion to what is known of the picture's error: `others`, which are no bias.
  double square(double known, double others) const;
};

/// One correction under way. One thread at a time.
class MeasuredCorrection {
 public:
  /// `features` must outlive this; they may get more samples, but not begin anew. `scattering`:
  /// FeatureImage::scattering() of each pixel, 1 where that is 0.
  MeasuredCorrection(const FeatureImage& features, NoisyPixels noisy,
                     const std::vector<float>& scattering);
  /// Works until done or keepGoing() says no; true once done.
  bool advance(const std::function<bool()>& keepGoing);
  /// Once done: the correction of a picture, which decides what an error weighs.
  std::vector<vec3> take(const std::vector<vec3>& picture);
  /// Then: in relMSE, the bias that the picture still has.
  const BiasLeft& left() const { return left_; }

 private:
  struct Shared;
  GuessFilter filterOf(std::uint32_t half) const;
  GuessFilter filterOfAll() const;
  CellWeights<Shared> measure(const std::vector<vec3>& weigh) const;
  BiasFigures biasOf(const std::vector<vec3>& weigh, std::uint32_t size) const;

  const FeatureImage* features_;
  std::uint32_t width_, height_;
  std::vector<float> scattering_;
  std::vector<vec3> raw_, variance_;
  std::vector<vec3> filtered_[2], all_;  ///< of each half, which tells how much of all is true
  std::optional<GuessFilter> filter_;    ///< the one under way: they are large, and dear to begin
  BiasLeft left_;
};

}  // namespace trex
