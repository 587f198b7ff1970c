// What a piece of work takes its thread.
//
// Seconds on the wall are more than that where others want the processor, or a quota keeps the
// process from it: a thread that lost its processor for 10 ms while it read a page has not met a
// slow disk. So processor time counts, and, if the thread went to sleep by itself (for a disk), all
// of the time.
#pragma once

#include <cstdint>

namespace hccm {

/// Of the calling thread.
struct ThreadMoment {
  double now = 0.0;          ///< seconds of a clock that never goes back
  double processor = 0.0;    ///< seconds that it had one
  std::uint64_t sleeps = 0;  ///< times that it waited for something
};
ThreadMoment threadMoment();

/// Seconds of what was done between two moments.
inline double secondsTaken(const ThreadMoment& start, const ThreadMoment& end) {
  return end.sleeps == start.sleeps ? end.processor - start.processor : end.now - start.now;
}

}  // namespace hccm
