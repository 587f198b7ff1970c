// How many threads work at once, and the limit of a process.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <string>

namespace trex {

/// Of the calling oneTBB arena, within the limit of the process (`--threads`), which the arena's
/// own size does not know of. At least 1. Thread safe.
inline int threadsAllowed() {
  const std::size_t limit =
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  const auto arena = static_cast<std::size_t>(std::max(tbb::this_task_arena::max_concurrency(), 1));
  return static_cast<int>(std::max<std::size_t>(std::min(limit, arena), 1));
}

/// The limit of `--threads` while it lives, of oneTBB and of lavapipe, which has threads of its own
/// and reads theirs when it starts (LP_NUM_THREADS goes before). 0: none. Made before other
/// threads.
class ThreadLimit {
 public:
  explicit ThreadLimit(int threads) {
    if (threads <= 0) return;
    limit_.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 0);
  }

 private:
  std::optional<tbb::global_control> limit_;
};

}  // namespace trex
