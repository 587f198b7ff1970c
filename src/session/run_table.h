// Which run a number lies in, where runs of any lengths are numbered on.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace trex {

/// Filled by add(), then finish(); find() is thread safe. Fewer than 2^32 runs; 8 to 16 bytes each.
class RunTable {
 public:
  void add(std::uint64_t length) { firsts_.push_back(firsts_.back() + length); }
  /// Makes find() quick: about a block of numbers a run, of which the first run is kept.
  void finish() {
    if (count() == 0) return;
    while (count() >> shift_ > firsts_.size()) ++shift_;
    starts_.clear();
    std::size_t run = 0;
    for (std::uint64_t i = 0; i < count(); i += std::uint64_t{1} << shift_) {
      while (firsts_[run + 1] <= i) ++run;
      starts_.push_back(static_cast<std::uint32_t>(run));
    }
    starts_.push_back(static_cast<std::uint32_t>(firsts_.size() - 2));
  }
  /// Of all runs.
  std::uint64_t count() const { return firsts_.back(); }
  /// The run of number i, below count(), and i's place in it.
  std::size_t find(std::uint64_t i, std::uint32_t& place) const {
    const std::size_t block = static_cast<std::size_t>(i >> shift_);
    const auto begin = firsts_.begin() + static_cast<std::ptrdiff_t>(starts_[block]) + 1;
    const auto end = firsts_.begin() + static_cast<std::ptrdiff_t>(starts_[block + 1]) + 1;
    const auto run =
        static_cast<std::size_t>(std::upper_bound(begin, end, i) - firsts_.begin()) - 1;
    place = static_cast<std::uint32_t>(i - firsts_[run]);
    return run;
  }

 private:
  std::vector<std::uint64_t> firsts_{0};  ///< number of the first of each run, and of all
  std::vector<std::uint32_t> starts_;     ///< run of the first number of each block, and the last
  int shift_ = 0;
};

}  // namespace trex
