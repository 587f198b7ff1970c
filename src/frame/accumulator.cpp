#include "src/frame/accumulator.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace trex {
namespace {
constexpr std::size_t kReported = 16;
}

Accumulator::Accumulator(std::uint32_t width, std::uint32_t height, bool pairs)
    : width_(width), height_(height), guess_(static_cast<std::size_t>(width) * height) {
  if (pairs) difference_.resize(guess_.size());
}

bool Accumulator::add(std::uint32_t x, std::uint32_t y, std::uint32_t sample, const vec3& guess,
                      const vec3* exact) {
  if (!isFinite(guess) || (exact != nullptr && !isFinite(*exact))) {
    dropNonFinite({x, y, sample});
    return false;
  }
  guess_[index(x, y)].add(guess);
  if (exact != nullptr && !difference_.empty()) difference_[index(x, y)].add(guess, *exact);
  return true;
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

void Accumulator::restart() {
  const std::lock_guard lock(mutex_);
  nonFiniteCount_ = 0;
  nonFinite_.clear();
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

/// Mean of the pixels around one, itself where it has none.
dvec3 Accumulator::neighbourMean(std::uint32_t x, std::uint32_t y) const {
  dvec3 sum(0.0);
  double count = 0.0;
  const std::uint32_t right = std::min(x + 1, width_ - 1), lower = std::min(y + 1, height_ - 1);
  for (std::uint32_t py = y > 0 ? y - 1 : 0; py <= lower; ++py) {
    for (std::uint32_t px = x > 0 ? x - 1 : 0; px <= right; ++px) {
      if (px == x && py == y) continue;
      sum += mean(px, py);
      count += 1.0;
    }
  }
  return count > 0.0 ? sum / count : mean(x, y);
}

double Accumulator::estimatedError(std::uint32_t stride) const {
  double total = 0.0, values = 0.0;
  std::uint64_t fewest = ~std::uint64_t{0};
  for (std::uint32_t y = 0; y < height_; y += stride) {
    for (std::uint32_t x = 0; x < width_; x += stride) {
      const dvec3 m = mean(x, y);
      total += m.x + m.y + m.z;
      values += 3.0;
      fewest = std::min(fewest, samples(x, y));
    }
  }
  if (fewest < 2) return std::numeric_limits<double>::infinity();
  const double floor = 0.01 * (total / values) * (total / values);
  double sum = 0.0;
  for (std::uint32_t y = 0; y < height_; y += stride) {
    for (std::uint32_t x = 0; x < width_; x += stride) {
      const dvec3 m = glm::min(mean(x, y), neighbourMean(x, y)), v = varianceOfMean(x, y);
      for (int c = 0; c < 3; ++c) {
        if (v[c] > 0.0) sum += v[c] / (m[c] * m[c] + floor);
      }
    }
  }
  return sum / values;
}

void Accumulator::restoreNonFinite(std::uint64_t count, std::vector<NonFiniteSample> samples) {
  nonFiniteCount_ = count;
  const std::lock_guard lock(mutex_);
  nonFinite_ = std::move(samples);
}

std::uint64_t Accumulator::bytesNeeded(std::uint32_t width, std::uint32_t height, bool pairs) {
  return std::uint64_t{width} * height *
         (sizeof(Moments) + (pairs ? sizeof(DifferenceMoments) : 0u));
}

}  // namespace trex
