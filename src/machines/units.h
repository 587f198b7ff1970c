// Units of jobs as tiles and samples of a frame.
#pragma once

#include <vector>

#include "src/frame/lattice.h"
#include "src/machines/jobs.h"
#include "src/session/scheduler.h"

namespace trex::machines {

/// Units of a job whose samples have numbers below 2^32.
inline std::vector<TileUnit> unitsOf(const Job& job, std::size_t tiles) {
  std::vector<TileUnit> units;
  for (std::uint64_t u = job.first; u < job.end; ++u) {
    units.push_back({.tile = static_cast<std::uint32_t>(u % tiles),
                     .sample = static_cast<std::uint32_t>(u / tiles),
                     .firstCell = 0,
                     .endCell = lattice::kCells});
  }
  return units;
}

/// Samples of units.
inline std::size_t samplesOf(std::span<const TileUnit> units, const std::vector<Tile>& tiles) {
  std::size_t samples = 0;
  for (const TileUnit& u : units)
    samples += std::size_t{tiles[u.tile].width} * tiles[u.tile].height;
  return samples;
}

}  // namespace trex::machines
