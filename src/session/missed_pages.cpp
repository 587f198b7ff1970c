#include "src/session/missed_pages.h"

#include <algorithm>

namespace trex {

void dropMissed(SampleBatch& batch) {
  batch.isVoid.assign(batch.jobs.size(), 0);
  std::size_t first = 0;
  for (std::size_t i = 0; i < batch.units.size(); ++i) {
    SampleBatch::Unit& unit = batch.units[i];
    for (std::size_t job = first; job < unit.endJob;
         job = (job / kJobsOfChunk + 1) * kJobsOfChunk) {
      unit.missed |= batch.missed[job / kJobsOfChunk] != 0;
    }
    for (std::size_t k = 0; k < i && !unit.missed; ++k) {
      const SampleBatch::Unit& before = batch.units[k];
      unit.missed =
          before.missed && before.unit.tile == unit.unit.tile && before.unit.look == unit.unit.look;
    }
    if (unit.missed) {
      std::fill(batch.isVoid.begin() + static_cast<std::ptrdiff_t>(first),
                batch.isVoid.begin() + static_cast<std::ptrdiff_t>(unit.endJob), std::uint8_t{1});
      std::erase(batch.finishedTiles, unit.unit.tile);
    }
    first = unit.endJob;
  }
  for (Cones& part : batch.cones) {
    std::erase_if(part.requests, [&](const ConeRequest& r) { return batch.isVoid[r.job] != 0; });
  }
  for (std::size_t i = 0; i < batch.rays.size(); ++i) {
    if (batch.isVoid[i] != 0) batch.rays[i] = {};
  }
}

void putBack(TileScheduler& tiles, const hccm::PageFetcher& fetcher, const SampleBatch& batch) {
  for (auto unit = batch.units.rbegin(); unit != batch.units.rend(); ++unit) {
    if (unit->missed) {
      tiles.putBack(unit->unit, fetcher.asked());
    } else {
      tiles.wasWhole(unit->unit.tile);
    }
  }
}

}  // namespace trex
