// What a lattice of a frame's pixels shows, with all light that is known of it: of the samples of
// the pixels that each of its points stands for, and of what is remembered of the surface.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>

#include "src/frame/features.h"
#include "src/session/frame_buffers.h"

namespace trex {

/// One such lattice under way. One thread at a time; the work is done in its oneTBB arena.
class LatticeFeatures {
 public:
  /// Of what every step-th pixel of every step-th row shows most. `frame` must outlive this; it may
  /// get more samples meanwhile, but not begin anew.
  LatticeFeatures(const FrameBuffers& frame, std::uint32_t step);
  /// As GuessFilter::advance().
  bool advance(const std::function<bool()>& keepGoing);
  /// Once advance() is true.
  FeatureImage take() { return std::move(lattice_); }

 private:
  void gather(std::uint32_t x, std::uint32_t y);

  const FrameBuffers* frame_;
  std::uint32_t step_;
  FeatureImage lattice_;
  std::uint32_t row_ = 0;  ///< all before it are done
};

/// Joins what the frame's memory knows of the light of pixel (x, y) of a lattice, if that shows one
/// surface. `step`: pixels between two of the lattice.
void joinMemory(const LightMemory& memory, FeatureImage& lattice, std::uint32_t x, std::uint32_t y,
                std::uint32_t step);

}  // namespace trex
