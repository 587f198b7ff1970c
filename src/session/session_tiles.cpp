// Samples: from units of tiles to pixels, rays, and sums.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>

#include "src/frame/lattice.h"
#include "src/session/batch.h"
#include "src/session/light_side.h"

namespace trex {
namespace {

constexpr std::size_t kChunk = 64;  // jobs that a thread takes at a time

}  // namespace

void Session::addJobs(const FrameBuffers& frame, const TileUnit& unit, Batch& batch) const {
  const Tile& tile = frame.tiles.tiles()[unit.tile];
  batch.full = true;
  if (unit.endCell == lattice::kCells || lattice::spacing(unit.endCell) > 0) {
    batch.finishedTiles.push_back(unit.tile);
  }
  if (unit.firstCell == 0 && unit.endCell == lattice::kCells) {
    for (std::uint32_t y = 0; y < tile.height; ++y) {
      for (std::uint32_t x = 0; x < tile.width; ++x) {
        batch.jobs.push_back({tile.x + x, tile.y + y, unit.sample});
      }
    }
    return;
  }
  for (std::uint32_t y = 0; y < tile.height; y += lattice::kSide) {
    for (std::uint32_t x = 0; x < tile.width; x += lattice::kSide) {
      for (std::uint32_t cell = unit.firstCell; cell < unit.endCell; ++cell) {
        const lattice::Place at = lattice::kPlaces[cell];
        if (x + at.x >= tile.width || y + at.y >= tile.height) continue;
        batch.jobs.push_back({tile.x + x + at.x, tile.y + y + at.y, unit.sample});
      }
    }
  }
}

void Session::prepareCaustics(const Batch& batch) {
  if (!caustics_) return;
  std::vector<std::uint32_t> samples;
  for (const Batch::Job& job : batch.jobs) {
    if (std::find(samples.begin(), samples.end(), job.sample) == samples.end()) {
      samples.push_back(job.sample);
    }
  }
  caustics_->prepare(samples);
}

/// First stage: C-rays on all CPU threads; the cones start on the device.
void Session::trace(const Integrator& integrator, Batch& batch) {
  const std::size_t count = batch.jobs.size(), chunks = (count + kChunk - 1) / kChunk;
  batch.paths.assign(count, PathSample{});
  batch.paired.assign(count, 0);
  if (layers_.rayClass) batch.rays.assign(count, vec2(0.0f));
  batch.cones.resize(chunks);
  std::vector<RayCounts> counts(chunks);
  if (&integrator == integrator_.get()) prepareCaustics(batch);
  const bool pairs = integrator.guesses() && &integrator != previewIntegrator_.get();
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    batch.cones[chunk].clear();
    for (std::size_t i = chunk * kChunk; i < std::min(count, (chunk + 1) * kChunk); ++i) {
      const auto& [x, y, sample] = batch.jobs[i];
      const double offset = toUnitFloat(hashCombine(hashCombine(x, y), settings_.seed));
      const bool exact = pairs && takesExact(sample, settings_.exact, offset);
      batch.paired[i] = exact;
      RayCounts rays;
      batch.paths[i] = integrator.sample(x, y, settings_.width, sample, exact,
                                         static_cast<std::uint32_t>(i), batch.cones[chunk], rays);
      if (layers_.rayClass) {
        batch.rays[i] = vec2(static_cast<float>(rays.cRays + rays.shadowRays),
                             static_cast<float>(rays.cones + rays.cacheReads));
      }
      counts[chunk].add(rays);
    }
  });
  for (const RayCounts& c : counts) report_.rays.add(c);
  batch.queries.clear();
  for (const auto& part : batch.cones) {
    for (const ConeRequest& r : part) {
      batch.queries.push_back({r.origin, r.tanHalf, r.direction, r.tmin, r.tmax, r.jitter,
                               r.shadow ? shaderio::kQueryShadow : 0u, 0u});
    }
  }
  batch.ticket.reset();
  if (!batch.queries.empty()) batch.ticket = light_->device->submitGather(batch.queries);
}

/// Second stage: the device's answers join their pixels, the samples enter the frame.
void Session::merge(FrameBuffers& frame, Batch& batch) {
  if (!batch.full) return;
  batch.full = false;
  if (batch.ticket) {
    const auto scale = static_cast<float>(light_->cache->scale());
    const auto results = light_->device->finishGather(*batch.ticket);
    std::size_t next = 0;
    for (const auto& part : batch.cones) {
      for (const ConeRequest& r : part) {
        const shaderio::GatherResult& answer = results[next++];
        PathSample& path = batch.paths[r.pixel];
        const vec3 passed = r.background * answer.transmittance;
        path.guess += r.weight * answer.radiance * scale + passed;
        if (r.direct) path.direct += passed;
      }
    }
  }
  for (std::size_t i = 0; i < batch.jobs.size(); ++i) add(frame, batch, i);
  if (settings_.interactive) {
    for (const std::uint32_t tile : batch.finishedTiles) rateTile(frame, tile);
  }
  batch.jobs.clear();
  batch.finishedTiles.clear();
}

/// A finished sample enters the frame and its layers.
void Session::add(FrameBuffers& frame, const Batch& batch, std::size_t i) {
  const auto& [x, y, sample] = batch.jobs[i];
  const PathSample& p = batch.paths[i];
  const vec3 exact = p.common + p.exact;
  const bool paired = batch.paired[i] != 0;
  if (sample == 0) frame.restart(x, y);
  const bool finite = frame.sums.add(x, y, sample, p.common + p.guess, paired ? &exact : nullptr);
  if (frame.features && finite) {
    frame.features->add(x, y, p.feature, p.common - p.own + p.guess);
  }
  if (frame.coverage) frame.coverage->add(x, y, p.alpha);
  if (frame.firstHits) frame.firstHits->add(x, y, sample, p.first);
  if (frame.direct && finite) frame.direct->add(x, y, p.direct, paired ? &p.directExact : nullptr);
  if (frame.rayClasses) frame.rayClasses->add(x, y, batch.rays[i].x, batch.rays[i].y);
}

/// The error of a tile for the order of tiles: of noise once pixels have two samples, before that
/// the contrast between them.
void Session::rateTile(FrameBuffers& frame, std::uint32_t tile) const {
  const Tile& t = frame.tiles.tiles()[tile];
  const TileState& state = frame.tiles.state(tile);
  const std::uint32_t step = state.sample > 0 ? 2 : std::max(1u, lattice::spacing(state.cells));
  double sum = 0.0, square = 0.0, noise = 0.0, count = 0.0;
  for (std::uint32_t y = 0; y < t.height; y += step) {
    for (std::uint32_t x = 0; x < t.width; x += step) {
      const double value = luminance(frame.sums.mean(t.x + x, t.y + y));
      sum += value;
      square += value * value;
      if (state.sample >= 2) noise += luminance(frame.sums.varianceOfMean(t.x + x, t.y + y));
      count += 1.0;
    }
  }
  const double mean = sum / count, spread = std::max(0.0, square / count - mean * mean);
  const double error = state.sample >= 2 ? noise / count + 0.01 * spread / state.sample : spread;
  frame.tiles.setError(tile, static_cast<float>(error / (mean * mean + 1e-12)));
}

}  // namespace trex
