#include "src/frame/accumulator.h"

namespace trex {
namespace {
constexpr std::size_t kReported = 16;
}

Accumulator::Accumulator(std::uint32_t width, std::uint32_t height, bool pairs)
    : width_(width), height_(height), guess_(static_cast<std::size_t>(width) * height) {
  if (pairs) difference_.resize(guess_.size());
}

void Accumulator::add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& guess,
                      const vec3* exact) {
  if (!isFinite(guess) || (exact != nullptr && !isFinite(*exact))) {
    dropNonFinite({x, y, sample});
    return;
  }
  guess_[index(x, y)].add(guess);
  if (exact != nullptr && !difference_.empty()) difference_[index(x, y)].add(guess, *exact);
}

void Accumulator::dropNonFinite(const NonFiniteSample& sample) {
  ++nonFiniteCount_;
  const std::lock_guard lock(mutex_);
  if (nonFinite_.size() < kReported) nonFinite_.push_back(sample);
}

dvec3 Accumulator::mean(std::uint32_t x, std::uint32_t y) const {
  const std::size_t i = index(x, y);
  return difference_.empty() ? guess_[i].mean() : combinedMean(guess_[i], difference_[i]);
}

dvec3 Accumulator::varianceOfMean(std::uint32_t x, std::uint32_t y) const {
  const std::size_t i = index(x, y);
  return difference_.empty() ? guess_[i].varianceOfMean()
                             : combinedVariance(guess_[i], difference_[i]);
}

std::uint64_t Accumulator::samples(std::uint32_t x, std::uint32_t y) const {
  return guess_[index(x, y)].count();
}

std::uint64_t Accumulator::pairs(std::uint32_t x, std::uint32_t y) const {
  return difference_.empty() ? 0 : difference_[index(x, y)].difference().count();
}

std::vector<NonFiniteSample> Accumulator::nonFiniteSamples() const {
  const std::lock_guard lock(mutex_);
  return nonFinite_;
}

std::uint64_t Accumulator::bytesNeeded(std::uint32_t width, std::uint32_t height, bool pairs) {
  return std::uint64_t{width} * height *
         (sizeof(Moments) + (pairs ? sizeof(DifferenceMoments) : 0u));
}

}  // namespace trex
