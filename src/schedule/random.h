// Random numbers that are the same on every machine.
#pragma once

#include <cstdint>
#include <random>

namespace trex::schedule {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  /// In [0, 1).
  double operator()() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  /// In [0, n).
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((*this)() * n); }
  /// Of mean 0 and variance 1, near enough normal: a sum of twelve.
  double normal() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += (*this)();
    return sum;
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace trex::schedule
