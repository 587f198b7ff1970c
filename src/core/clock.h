// Time that passes.
#pragma once

#include <chrono>

namespace trex {

/// Seconds of a clock that never goes back; only differences mean anything. Thread safe.
inline double secondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace trex
