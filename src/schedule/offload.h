// How much of some work a device should take from processors that have other work as well.
#pragma once

#include <cstdint>

#include "src/schedule/timing.h"

namespace trex::schedule {

/// Work that comes in jobs of equal size. All times have one amount, or no rates: can't be done.
struct Offload {
  LinearTime kept;   ///< of a job, what is the processors' in any case
  LinearTime here;   ///< the rest of it, if the processors do that too, ...
  LinearTime there;  ///< ... and if the device does
  double units = 1;  ///< of a job, above 0
};

constexpr std::uint32_t kDealtJobs = 64;

/// Of kDealtJobs, how many plan() gives the device, so that both end as early as it finds:
/// processors and device are two devices of a graph, what is kept goes before the rest. A pure
/// function; thread safe.
std::uint32_t jobsForDevice(const Offload& work);

}  // namespace trex::schedule
