// What a job will take: linear in its amounts of work [Son and Yoon, HPG 2017].
//
//   T(d, j, W) = 0 if W is empty, else setup(d, j) + rates(d, j) . W
//
// Pure functions; thread safe.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace trex::schedule {

/// Of one kind of job on one device. All values are finite and at least 0.
struct LinearTime {
  double setup = 0.0;         ///< seconds a job
  std::vector<double> rates;  ///< seconds a unit of each amount
  /// `amounts` are at least 0; as many as rates are used, none counts as 0.
  double seconds(std::span<const double> amounts) const;
};

/// Whether a number can be an amount, a time or a size: finite, and at least 0.
bool isAmount(double value);

/// One measured job.
struct TimingSample {
  std::vector<double> amounts;  ///< finite, at least 0
  double seconds = 0.0;         ///< finite, above 0
};

/// The parameters that explain the samples best: least squares of relative errors, since jobs of
/// all sizes are to be told; no parameter is below 0; samples far off the others (a page fault,
/// another program) lose their weight [Holland and Welsch 1977, Huber's weights]. Where samples do
/// not tell parameters apart (few of them, amounts that go together) time goes to rates rather than
/// to the setup, and is shared evenly among rates. Throws Error(kInput) without samples, for more
/// than 8 amounts or different numbers of them, and for values out of their ranges.
LinearTime fitLinear(std::span<const TimingSample> samples);

/// Of each kind of job on each device. A kind of no rates, as all are at first, the device can't
/// do.
class TimingModel {
 public:
  TimingModel(std::uint32_t devices, std::uint32_t kinds)
      : kinds_(kinds), times_(std::size_t{devices} * kinds) {}
  /// Throws Error(kInput) if a parameter is not finite or below 0.
  void set(std::uint32_t device, std::uint32_t kind, LinearTime time);
  const LinearTime& at(std::uint32_t device, std::uint32_t kind) const {
    return times_[std::size_t{device} * kinds_ + kind];
  }
  std::uint32_t kinds() const { return kinds_; }
  std::uint32_t devices() const { return static_cast<std::uint32_t>(times_.size() / kinds_); }

 private:
  std::uint32_t kinds_;
  std::vector<LinearTime> times_;
};

}  // namespace trex::schedule
