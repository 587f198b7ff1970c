#include "src/session/lattice_features.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "src/core/sampler.h"

namespace trex {
namespace {

constexpr std::uint32_t kBandPoints = 4096;  // of the lattice, between two questions

}  // namespace

void joinMemory(const LightMemory& memory, FeatureImage& lattice, std::uint32_t x, std::uint32_t y,
                std::uint32_t step) {
  FeaturePart part = lattice.most(x, y);
  if (lattice.rest(x, y).count > 0.0f) return;
  part.mean.footprint /= static_cast<float>(step);
  if (!memory.join(part, Sampler(y * lattice.width() + x, 0, 0x6d656d6fu).next2D())) return;
  part.mean.footprint *= static_cast<float>(step);
  lattice.put(x, y, part);
}

LatticeFeatures::LatticeFeatures(const FrameBuffers& frame, std::uint32_t step)
    : frame_(&frame),
      step_(step),
      lattice_((frame.features->width() + step - 1) / step,
               (frame.features->height() + step - 1) / step) {}

void LatticeFeatures::gather(std::uint32_t column, std::uint32_t row) {
  const FeatureImage& all = *frame_->features;
  FeaturePart sum = all.most(column * step_, row * step_);
  sum.mean.footprint *= static_cast<float>(step_);
  for (std::uint32_t i = 0; i < step_ * step_; ++i) {
    const std::uint32_t x = column * step_ + i % step_, y = row * step_ + i / step_;
    if (x >= all.width() || y >= all.height() || !frame_->tiles.sampled(x, y)) continue;
    if (i > 0) sum.join(all.most(x, y));
    sum.join(all.rest(x, y));
  }
  lattice_.put(column, row, sum);
  if (frame_->memory) joinMemory(*frame_->memory, lattice_, column, row, step_);
}

bool LatticeFeatures::advance(const std::function<bool()>& keepGoing) {
  const std::uint32_t width = lattice_.width(), height = lattice_.height();
  const std::uint32_t band = std::max(kBandPoints / width, 2u);
  while (row_ < height) {
    const std::uint32_t end = std::min(row_ + band, height);
    tbb::parallel_for(row_, end, [&](std::uint32_t row) {
      for (std::uint32_t column = 0; column < width; ++column) gather(column, row);
    });
    row_ = end;
    if (row_ < height && !keepGoing()) return false;
  }
  return true;
}

}  // namespace trex
