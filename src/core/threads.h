// How many threads work at once.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>

namespace trex {

/// Of the calling oneTBB arena, within the limit of the process (`--threads`), which the arena's
/// own size does not know of. At least 1. Thread safe.
inline int threadsAllowed() {
  const std::size_t limit =
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  const auto arena = static_cast<std::size_t>(std::max(tbb::this_task_arena::max_concurrency(), 1));
  return static_cast<int>(std::max<std::size_t>(std::min(limit, arena), 1));
}

}  // namespace trex
