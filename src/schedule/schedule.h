// What is planned, or has happened: jobs on devices and fetches on channels, with their times.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "src/schedule/graph.h"

namespace trex::schedule {

/// Data that jobs read: a block, a texture, a queue.
struct Item {
  double bytes = 0.0;        ///< 0: nothing to bring
  std::uint64_t copies = 0;  ///< bit m: there is one in memory m
  /// A transfer moves it, and it is in nobody's cache (a queue of units of work): never evicted,
  /// and outside of the capacities. It is read in Device::host, all else in Device::memory.
  bool moves = false;
  double need = 0.0;     ///< what is evicted first has the least: needed latest. 0: never
  double lastUse = 0.0;  ///< seconds; for eviction of what was used longest ago
};

/// Work that one device does at one time. There is no job while all amounts are 0.
struct Job {
  std::uint32_t kind = 0;            ///< of the timing model; means nothing else here
  std::vector<std::uint32_t> reads;  ///< items, each once
  std::vector<double> amounts;       ///< of the timing model
  double worth = 0.0;       ///< of finishing it, in a unit that all jobs share; for Rule::kMostWork
  double scratch = 0.0;     ///< bytes of Device::memory while it runs
  double readySince = 0.0;  ///< seconds; jobs that became ready earlier go first where order counts
};

/// One transfer over one channel.
struct Fetch {
  std::uint32_t item = 0, channel = 0, from = 0, to = 0;
  double start = 0.0, end = 0.0;
  std::vector<std::uint32_t> evicted;  ///< items whose copy in `to` is given up at the start
};

/// One job on one device.
struct Run {
  std::uint32_t job = 0, device = 0;
  double start = 0.0, end = 0.0;
  std::vector<std::uint32_t> evicted;  ///< from the device's memory, at the start, for scratch
};

struct Schedule {
  std::vector<Fetch> fetches;
  std::vector<Run> runs;
  std::uint32_t cursor = 0;   ///< where a rule that goes round has stopped
  double whole = -kNever;     ///< seconds: when all was planned anew that has not begun
  std::uint64_t feeding = 0;  ///< bit c: then channel c brought something from a store, or will
  /// When all has ended; 0 if there is nothing.
  double makespan() const;
};

/// What is wrong with a schedule that starts with these copies, or nothing: a device with two jobs
/// or a channel with two transfers at once, a transfer of what is not there or over no link, a job
/// without one of the items that it reads, a capacity exceeded, something evicted that is in use,
/// times that are not finite or run backwards. Items that move are not followed.
std::string problemOf(const Schedule& schedule, const Graph& graph, std::span<const Item> items,
                      std::span<const Job> jobs);

}  // namespace trex::schedule
