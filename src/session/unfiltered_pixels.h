// What pixels show that no filter has touched: the picture without a denoiser, and layers.
//
// With a given share of exact samples that is mean(G) + mean(D), whatever D's noise: right on
// average from the first pair on. A dial takes few pairs while bias does not show: a pixel's own
// differences would add far more noise than they take bias away. So of them as much is added as
// stands out of their noise, like what a filter makes of them (measured_correction.h): nothing
// before each pixel of a tile has two pairs, all in the end.
#pragma once

#include <vector>

#include "src/session/cell_weights.h"
#include "src/session/frame_buffers.h"

namespace trex {

/// Of a frame as it is, which must outlive this and get no samples meanwhile.
class UnfilteredPixels {
 public:
  explicit UnfilteredPixels(const FrameBuffers& frame);

  dvec3 mean(std::uint32_t x, std::uint32_t y) const;
  /// Of mean().
  dvec3 variance(std::uint32_t x, std::uint32_t y) const;
  /// The direct part of mean(). The frame must keep it.
  dvec3 direct(std::uint32_t x, std::uint32_t y) const;
  /// Estimated relMSE of mean(): of its noise (Accumulator::estimatedError()), and with a dial of
  /// the bias that shows and is not taken away. Infinite below two samples a pixel.
  double estimatedError() const;

 private:
  /// Of a cell: squares of differences, and what of them is noise.
  struct Squares {
    double all = 0.0, noise = 0.0, doubt = 0.0;
    void add(const Squares& o);
    double weight() const;
  };

  /// Of a tile.
  struct Known {
    bool enough = false;  ///< each pixel has two pairs
    dvec3 variance{0.0};  ///< of one difference, its pixels' mean
  };

  void measure(std::size_t tile);
  double part(std::uint32_t x, std::uint32_t y) const;
  dvec3 differenceVariance(std::uint32_t x, std::uint32_t y) const;

  const FrameBuffers& frame_;
  CellWeights<Squares> parts_;
  std::vector<Known> known_;  ///< by tile
};

}  // namespace trex
