// The progressive frame: sums per pixel that stay exact for 10^6 frames.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "src/core/maths.h"
#include "src/core/memory.h"
#include "src/frame/estimator.h"

namespace trex {

/// A sample that was dropped because it was not finite.
struct NonFiniteSample {
  std::uint32_t x, y, sample;
};

/// Guess and difference sums of width x height pixels. Pixels may be filled from different threads
/// at once, one pixel by one thread. The difference sums exist only where 0 < share < 1.
class Accumulator {
 public:
  /// width, height >= 1; `pairs` asks for the difference sums.
  Accumulator(std::uint32_t width, std::uint32_t height, bool pairs);

  std::uint32_t width() const { return width_; }
  std::uint32_t height() const { return height_; }

  /// Whether the difference sums exist.
  bool keepsPairs() const { return !difference_.empty(); }

  /// Adds a sample; `exact` may be null. A sample with a non-finite value never reaches the sums:
  /// it is counted, the first few are kept for the report, and the answer is false.
  bool add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& guess,
           const vec3* exact);

  /// Forgets a pixel's samples; restart() the counts of non-finite ones. Together, with every pixel
  /// restarted before its first sample, they begin a new picture without touching all of its
  /// memory.
  void restart(std::uint32_t x, std::uint32_t y) {
    guess_[index(x, y)] = {};
    if (!difference_.empty()) difference_[index(x, y)] = {};
  }
  void restart();

  dvec3 mean(std::uint32_t x, std::uint32_t y) const;
  dvec3 varianceOfMean(std::uint32_t x, std::uint32_t y) const;
  /// The parts of mean(): the guess, and the difference, which is 0 without pairs.
  const Moments& guess(std::uint32_t x, std::uint32_t y) const { return guess_[index(x, y)]; }
  Moments difference(std::uint32_t x, std::uint32_t y) const {
    return difference_.empty() ? Moments{} : difference_[index(x, y)].difference();
  }
  std::uint64_t samples(std::uint32_t x, std::uint32_t y) const;
  std::uint64_t pairs(std::uint32_t x, std::uint32_t y) const;

  /// Estimated relMSE of the picture, from noise alone: the mean over pixels and channels of
  /// variance / (r^2 + 0.01 m^2), m the picture's mean. r is the pixel's mean or that of its eight
  /// neighbours, whichever is less: a firefly would hide in a mean that it has raised itself.
  /// Infinite below two samples a pixel.
  double estimatedError(std::uint32_t stride = 1) const;

  /// The sums, to be saved and put back into an accumulator of the same size.
  std::span<std::byte> guessBytes() { return std::as_writable_bytes(std::span(guess_)); }
  std::span<std::byte> differenceBytes() { return std::as_writable_bytes(std::span(difference_)); }
  void restoreNonFinite(std::uint64_t count, std::vector<NonFiniteSample> samples);

  std::uint64_t nonFiniteCount() const { return nonFiniteCount_; }
  std::vector<NonFiniteSample> nonFiniteSamples() const;

  /// Bytes an accumulator takes, before it is made.
  static std::uint64_t bytesNeeded(std::uint32_t width, std::uint32_t height, bool pairs);

 private:
  std::size_t index(std::uint32_t x, std::uint32_t y) const {
    return static_cast<std::size_t>(y) * width_ + x;
  }
  dvec3 neighbourMean(std::uint32_t x, std::uint32_t y) const;
  void dropNonFinite(const NonFiniteSample& sample);

  std::uint32_t width_, height_;
  LargeVector<Moments> guess_;
  LargeVector<DifferenceMoments> difference_;
  std::atomic<std::uint64_t> nonFiniteCount_{0};
  mutable std::mutex mutex_;
  std::vector<NonFiniteSample> nonFinite_;
};

}  // namespace trex
