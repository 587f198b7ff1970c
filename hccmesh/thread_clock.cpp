#include "hccmesh/thread_clock.h"

#include <sys/resource.h>
#include <time.h>

namespace hccm {
namespace {

double secondsOf(clockid_t clock) {
  timespec t{};
  ::clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace

ThreadMoment threadMoment() {
  rusage used{};
  ::getrusage(RUSAGE_THREAD, &used);
  return {secondsOf(CLOCK_MONOTONIC), secondsOf(CLOCK_THREAD_CPUTIME_ID),
          static_cast<std::uint64_t>(used.ru_nvcsw)};
}

}  // namespace hccm
