// Units of work that go from station to station, as a list: what a simulation plays.
//
// A station is what has to be in memory for the unit to go on: a block of a model, for rays; a pair
// of hierarchies, for proximity queries; a cell of a grid with its neighbours, for particles.
#pragma once

#include <cstdint>
#include <vector>

namespace trex::schedule {

constexpr std::uint32_t kNoWalk = 0xffffffffu;

/// The way of one unit. Begins when its parent, if it has one, has been served at its place
/// `parentPlace`.
struct Walk {
  std::uint32_t first = 0, length = 0;  ///< in Workload::way; at least one station
  std::uint32_t parent = kNoWalk, parentPlace = 0;
  std::uint32_t kind = 0;  ///< of its jobs
};

/// Bytes and ways of everything.
struct Workload {
  std::vector<double> itemBytes;                  ///< of each item that is cached
  std::vector<std::vector<std::uint32_t>> reads;  ///< of each station: items, each once
  std::vector<double> scratch;                    ///< of each station: bytes while a job runs
  std::vector<std::uint32_t> way;                 ///< stations
  std::vector<Walk> walks;                        ///< parents before their children
  double unitsPerWalk = 1.0;                      ///< that go together
  double unitBytes = 0.0;                         ///< of one that waits
  std::uint32_t stations() const { return static_cast<std::uint32_t>(reads.size()); }
};

}  // namespace trex::schedule
