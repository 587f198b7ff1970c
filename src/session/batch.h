// Pixels between the two stages of a session: traced, and waiting for the device's cones. Private
// to src/session.
#pragma once

#include <optional>
#include <vector>

#include "src/session/session.h"

namespace trex {

struct Session::Batch {
  struct Job {
    std::uint32_t x, y, sample;
  };
  std::vector<Job> jobs;
  std::vector<std::uint32_t> finishedTiles;  ///< that come to a whole sample or level by it
  std::vector<PathSample> paths;             ///< by job
  std::vector<std::uint8_t> paired;
  std::vector<vec2> rays;                       ///< C-rays and G-rays, where wanted
  std::vector<std::vector<ConeRequest>> cones;  ///< by chunk of jobs, in their order
  std::vector<shaderio::GatherQuery> queries;
  std::optional<int> ticket;
  bool full = false;
};

}  // namespace trex
