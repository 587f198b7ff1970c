// Time that passes.
#pragma once

#include <sys/resource.h>

#include <chrono>

namespace trex {

/// Seconds of a clock that never goes back; only differences mean anything. Thread safe.
inline double secondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Seconds that processors have worked for this process, all of its threads. Thread safe.
inline double processorSeconds() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

}  // namespace trex
