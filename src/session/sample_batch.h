// Samples between the two stages of samples.h: traced, and waiting for the device's cones.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "src/grays/shaderio.h"
#include "src/paths/cones.h"
#include "src/paths/gather_plan.h"
#include "src/paths/path_sample.h"
#include "src/session/scheduler.h"

namespace trex {

inline constexpr std::size_t kJobsOfChunk = 64;  // that a thread takes at a time

/// Pixels of some units of tiles.
struct SampleBatch {
  struct Unit {
    TileUnit unit;
    std::size_t endJob = 0;
    bool missed = false;  ///< pages, or an earlier unit of its tile did: it comes to nothing
  };
  std::vector<PathJob> jobs;
  std::vector<Unit> units;           ///< of the jobs, in their order
  std::vector<std::uint8_t> missed;  ///< by chunk of jobs: a ray missed a page
  std::vector<std::uint8_t> isVoid;  ///< by job: of a unit that comes to nothing; empty: none is
  bool waits = false;                ///< for pages that are not there
  std::uint32_t looks = 0;           ///< of the jobs
  std::vector<std::uint32_t> finishedTiles;  ///< that come to a whole sample or level by it
  std::vector<PathSample> paths;             ///< by job
  std::vector<RayCounts> rays;               ///< by job
  std::vector<Cones> cones;                  ///< by chunk of jobs, in their order
  std::vector<shaderio::GatherQuery> queries;
  std::optional<int> ticket;
  GatherPlan* gathers = nullptr;  ///< is told when the device has answered; may be null
};

}  // namespace trex
