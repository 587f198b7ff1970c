// How much of some work goes to a device.
#include "src/schedule/offload.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace trex::schedule {
namespace {

LinearTime rate(double seconds, double setup = 0.0) { return {setup, {seconds}}; }

/// Seconds until both have ended, with so many jobs on the device.
double seconds(const Offload& w, std::uint32_t jobs) {
  const double amounts[] = {w.units};
  const auto on = [&](const LinearTime& t, std::uint32_t n) {
    return static_cast<double>(n) * t.seconds(amounts);
  };
  return std::max(on(w.kept, kDealtJobs) + on(w.here, kDealtJobs - jobs), on(w.there, jobs));
}

/// The best of all shares, within a job.
TEST(Offload, BalancesBothEnds) {
  for (const double kept : {0.0, 1e-7, 1e-6}) {
    for (const double here : {1e-8, 1e-7, 1e-6}) {
      for (const double there : {1e-10, 1e-8, 1e-7, 5e-7, 1e-6, 1e-5, 1e-3}) {
        for (const double setup : {0.0, 1e-4}) {
          const Offload w{rate(kept), rate(here), rate(there, setup), 4096.0};
          double best = seconds(w, 0);
          for (std::uint32_t jobs = 1; jobs <= kDealtJobs; ++jobs)
            best = std::min(best, seconds(w, jobs));
          const double amounts[] = {w.units};
          const double job = std::min(w.here.seconds(amounts), w.there.seconds(amounts));
          const std::uint32_t jobs = jobsForDevice(w);
          ASSERT_LE(jobs, kDealtJobs);
          EXPECT_LE(seconds(w, jobs), best + job * (1.0 + 1e-9))
              << kept << ' ' << here << ' ' << there << ' ' << setup << ": " << jobs;
        }
      }
    }
  }
}

TEST(Offload, KnowsWhoCanNot) {
  EXPECT_EQ(jobsForDevice({rate(1e-6), rate(1e-6), {}, 100.0}), 0u);
  EXPECT_EQ(jobsForDevice({rate(1e-6), {}, rate(1.0), 100.0}), kDealtJobs);
}

/// A device that is far faster than what is left to the processors takes all; what costs them
/// nothing stays there.
TEST(Offload, Extremes) {
  EXPECT_EQ(jobsForDevice({rate(1e-6), rate(1e-7), rate(1e-9), 4096.0}), kDealtJobs);
  EXPECT_EQ(jobsForDevice({rate(1e-6), rate(1e-9), rate(1.0), 4096.0}), 0u);
}

}  // namespace
}  // namespace trex::schedule
