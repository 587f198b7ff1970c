#include "src/session/samples.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <span>
#include <vector>

#include "hccmesh/page_cache.h"
#include "src/core/clock.h"
#include "src/crays/reading_pages.h"
#include "src/frame/estimator.h"
#include "src/frame/lattice.h"
#include "src/session/missed_pages.h"

namespace trex {

namespace {

constexpr double kBatchSeconds = 0.003;        // between two questions whether to go on
constexpr double kShareOfLimit = 0.2;          // see adaptWaiting()
constexpr std::size_t kLargestUnit = 64 * 64;  // pixels of a tile
constexpr std::uint32_t kLeastBatch = 256, kLargestBatch = 1u << 16;
constexpr std::uint32_t kLooksOfASample = 8;  // that cost about as much
/// A unit that so often missed pages waits for them: some went before others came.
constexpr std::uint32_t kMostTries = 12;
/// The same where others may take it: they may be late, or have another light.
constexpr std::uint32_t kMostTriesOfOthers = 60;

/// Calls `visit(x, y)` with the pixels of a unit of a frame, always in the same order.
template <typename Visit>
void eachPixel(const Tile& tile, const TileUnit& unit, const Visit& visit) {
  if (!unit.look && unit.firstCell == 0 && unit.endCell == lattice::kCells) {
    for (std::uint32_t y = 0; y < tile.height; ++y) {
      for (std::uint32_t x = 0; x < tile.width; ++x) visit(tile.x + x, tile.y + y);
    }
    return;
  }
  for (std::uint32_t y = 0; y < tile.height; y += lattice::kSide) {
    for (std::uint32_t x = 0; x < tile.width; x += lattice::kSide) {
      for (std::uint32_t cell = unit.firstCell; cell < unit.endCell; ++cell) {
        const lattice::Place at = lattice::kPlaces[cell];
        if (x + at.x >= tile.width || y + at.y >= tile.height) continue;
        visit(tile.x + x + at.x, tile.y + y + at.y);
      }
    }
  }
}

/// The pixels of a unit of a frame. `looks`: what is known of them; null if nothing is kept.
void addJobs(const Tile& tile, const TileUnit& unit, const LookImage* looks, SampleBatch& batch) {
  if (!unit.look && (unit.endCell == lattice::kCells || lattice::spacing(unit.endCell) > 0)) {
    batch.finishedTiles.push_back(unit.tile);
  }
  const bool again = looks != nullptr && unit.look && unit.sample > 0;
  eachPixel(tile, unit, [&](std::uint32_t x, std::uint32_t y) {
    if (again && !looks->wants(x, y, unit.sample)) return;
    batch.jobs.push_back({.x = x, .y = y, .sample = unit.sample, .look = unit.look});
    batch.looks += unit.look;
  });
}

/// Makes the maps that paths of a batch read. `sampleOf`: its number of an entry.
template <typename Entries, typename SampleOf>
void prepareCaustics(CausticMaps* caustics, const Entries& entries, const SampleOf& sampleOf) {
  if (caustics == nullptr) return;
  std::vector<std::uint32_t> samples;
  for (const auto& entry : entries) {
    const std::uint32_t sample = sampleOf(entry);
    if (std::find(samples.begin(), samples.end(), sample) == samples.end()) {
      samples.push_back(sample);
    }
  }
  caustics->prepare(samples);
}

/// Of a batch, in samples.
std::size_t costOf(const SampleBatch& batch) {
  return batch.jobs.size() - batch.looks + (batch.looks + kLooksOfASample - 1) / kLooksOfASample;
}

std::uint32_t costOf(const RayCounts& rays) {
  return static_cast<std::uint32_t>(rays.cRays + rays.shadowRays + rays.cones);
}

/// What sample i of a finished batch brings to a frame.
TakenSample takenOf(const SampleBatch& batch, std::size_t i) {
  const PathSample& p = batch.paths[i];
  return {.guess = p.common + p.guess,
          .exact = p.common + p.exact,
          .light = p.common - p.own + p.guess,
          .feature = p.feature,
          .first = p.first,
          .alpha = p.alpha,
          .direct = p.direct,
          .directExact = p.directExact,
          .photonNoise = p.photonNoise,
          .rays = costOf(batch.rays[i]),
          .cRays = static_cast<std::uint32_t>(batch.rays[i].cRays + batch.rays[i].shadowRays),
          .gRays = static_cast<std::uint32_t>(batch.rays[i].cones + batch.rays[i].cacheReads),
          .paired = batch.jobs[i].paired};
}

/// A sample enters its pixel's sums and layers.
void addSample(FrameBuffers& frame, std::uint32_t x, std::uint32_t y, std::uint32_t sample,
               const TakenSample& p) {
  if (sample == 0) frame.restart(x, y);
  const bool finite = frame.sums.add(x, y, sample, p.guess, p.paired ? &p.exact : nullptr);
  if (frame.features && finite) {
    frame.features->add(x, y, p.feature, p.light);
    if (frame.lightNoise) frame.lightNoise->add(x, y, sample, p.light);
    if (frame.memory) frame.memory->add(p.feature, p.light);
    if (frame.looks && sample > 0) frame.looks->add(x, y, sample, p.feature, p.guess - p.light);
  }
  if (frame.coverage) frame.coverage->add(x, y, p.alpha);
  if (frame.firstHits) frame.firstHits->add(x, y, sample, p.first);
  if (frame.direct && finite) {
    frame.direct->add(x, y, p.direct, p.paired ? &p.directExact : nullptr);
  }
  if (frame.rayClasses) {
    frame.rayClasses->add(x, y, static_cast<float>(p.cRays), static_cast<float>(p.gRays));
  }
  if (frame.photonNoise) frame.photonNoise->add(x, y, sample, p.photonNoise);
}

/// A sample or a look of a finished batch.
void addJob(FrameBuffers& frame, const SampleBatch& batch, std::size_t i) {
  const PathJob& job = batch.jobs[i];
  if (job.look) {
    const PathSample& p = batch.paths[i];
    frame.looks->add(job.x, job.y, job.sample, p.feature,
                     isFinite(p.common) ? p.common : vec3(0.0f), p.weight);
    return;
  }
  addSample(frame, job.x, job.y, job.sample, takenOf(batch, i));
}

/// All of a finished batch. `apart`: no two jobs are of one pixel, so all threads add them; those
/// that are not finite come last, in their order, for the report.
void mergeJobs(FrameBuffers& frame, const SampleBatch& batch, bool apart) {
  constexpr std::size_t kPixels = 256;
  const std::size_t count = batch.jobs.size();
  std::vector<std::uint8_t> added(count);
  const auto counts = [&](std::size_t i) { return batch.isVoid.empty() || batch.isVoid[i] == 0; };
  const auto finite = [&](const PathSample& p, bool paired) {
    return isFinite(p.common + p.guess) && (!paired || isFinite(p.common + p.exact));
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, apart ? count : 0, kPixels),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t i = range.begin(); i != range.end(); ++i) {
                        added[i] = counts(i) && finite(batch.paths[i], batch.jobs[i].paired);
                        if (added[i] != 0) addJob(frame, batch, i);
                      }
                    });
  for (std::size_t i = 0; i < count; ++i) {
    const PathJob& job = batch.jobs[i];
    if (!counts(i)) continue;
    if (added[i] == 0) addJob(frame, batch, i);
    if (!frame.dial || job.look) continue;
    frame.dial->add(frame.tiles.tileAt(job.x, job.y), job.paired, costOf(batch.rays[i]));
  }
}

/// The error of a tile for the order of tiles: of noise once pixels have two samples, before that
/// the contrast between them.
void rateTile(FrameBuffers& frame, std::uint32_t tile) {
  const Tile& t = frame.tiles.tiles()[tile];
  const TileState& state = frame.tiles.state(tile);
  const std::uint32_t step = state.sample > 0 ? 2 : std::max(1u, lattice::spacing(state.cells));
  double sum = 0.0, square = 0.0, noise = 0.0, count = 0.0;
  for (std::uint32_t y = 0; y < t.height; y += step) {
    for (std::uint32_t x = 0; x < t.width; x += step) {
      const double value = luminance(frame.rawMean(t.x + x, t.y + y));
      sum += value;
      square += value * value;
      if (state.sample >= 2) noise += luminance(frame.rawVariance(t.x + x, t.y + y));
      count += 1.0;
    }
  }
  const double mean = sum / count, spread = std::max(0.0, square / count - mean * mean);
  const double error = state.sample >= 2 ? noise / count + 0.01 * spread / state.sample : spread;
  frame.tiles.setError(tile, static_cast<float>(error / (mean * mean + 1e-12)));
}

}  // namespace

std::size_t pathsThatWait(const Scene& scene, std::uint64_t bytes) {
  return static_cast<std::size_t>(bytes / memoryOfPaths(scene, 1));
}

std::uint64_t memoryOfPaths(const Scene& scene, std::uint64_t paths) {
  return paths * (BatchedTracer::bytesAPath(scene) + sizeof(PathJob) + sizeof(PathSample) +
                  sizeof(RayCounts));
}

void SampleTaker::take(FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
                       const std::function<bool()>& keepGoing, vec2 pointer) {
  frame.tiles.beginFrame(pointer, batchPixels_ / 4);
  const hccm::PageFetcher* fetcher = source.behind != nullptr ? source.behind->fetcher() : nullptr;
  if (fetcher != nullptr) frame.tiles.setPages(readingPages([&] { return fetcher->brought(); }));
  SampleBatch batches[2];
  bool more = true;
  for (std::size_t i = 0; more; ++i) {
    const bool lacksAll = frame.tiles.coarseCells() == 0 && frame.tiles.pagesAwaited() == 0;
    const bool must = interactive_ && (i == 0 || lacksAll);
    if (!must && !keepGoing()) break;
    const double mark = secondsNow();
    SampleBatch& batch = batches[i % 2];
    const std::uint32_t samples = frame.tiles.samplesDone(), tiles = frame.tiles.tilesDone();
    more = fill(frame, source, batch);
    const std::size_t jobs = batch.jobs.size(), cost = costOf(batch);
    // Of nothing nothing is given up: the first samples of a picture are awaited.
    const bool mayGiveUp = samples > 0 || tiles > 0;
    if (jobs > 0 && !trace(frame, source, light, batch, mayGiveUp)) {
      frame.tiles.restore(samples, tiles);
      batch.jobs.clear();
      break;
    }
    if (fetcher != nullptr) putBack(frame.tiles, *fetcher, batch);
    merge(frame, source, light, batches[(i + 1) % 2]);
    if (source.batched) merge(frame, source, light, batch);  // there is no room for two
    adapt(secondsNow() - mark, cost);
    if (source.batched) adaptWaiting(secondsNow() - mark, jobs);
  }
  for (SampleBatch& batch : batches) merge(frame, source, light, batch);
}

/// Pixels of a batch: one unit of a sweep, of the viewer's as many as it has time for.
std::size_t SampleTaker::wanted(const SampleSource& source, std::size_t pixels) const {
  if (source.batched) {
    return std::max<std::size_t>(pathsAtOnce(pixels), kLargestUnit) - kLargestUnit + 1;
  }
  return interactive_ ? batchPixels_ : 1;
}

/// Units for a batch. False once none is left.
bool SampleTaker::fill(FrameBuffers& frame, const SampleSource& source, SampleBatch& batch) const {
  const std::size_t most = wanted(source, std::size_t{frame.sums.width()} * frame.sums.height());
  while (costOf(batch) < most) {
    const auto unit = frame.tiles.next();
    if (!unit) return false;
    addJobs(frame.tiles.tiles()[unit->tile], *unit, frame.looks.get(), batch);
    batch.units.push_back({*unit, batch.jobs.size()});
    batch.waits = frame.tiles.state(unit->tile).tries >=
                  (source.waitsAtLast ? kMostTries : kMostTriesOfOthers);
    if (batch.waits) break;
  }
  return true;
}

void SampleTaker::adapt(double seconds, std::size_t cost) {
  if (seconds > 1.5 * kBatchSeconds) batchPixels_ = std::max(batchPixels_ / 2, kLeastBatch);
  if (seconds < 0.5 * kBatchSeconds && cost >= batchPixels_) {
    batchPixels_ = std::min(batchPixels_ * 2, kLargestBatch);
  }
}

/// Where the seconds are limited a batch takes a share of them: it can't be stopped with what it
/// has. (But it takes whole tiles, and the first one a whole sample, without which there is no
/// picture.)
void SampleTaker::adaptWaiting(double seconds, std::size_t jobs) {
  if (limit_ <= 0.0 || jobs == 0) return;
  const double most = kShareOfLimit * limit_ * static_cast<double>(jobs) / std::max(seconds, 1e-3);
  waiting_ = std::clamp(static_cast<std::size_t>(most), std::min(2 * kLargestUnit, mostWaiting_),
                        mostWaiting_);
}

/// Makes jobs of a batch ready: which of them are pairs, and room for what they bring.
void SampleTaker::prepare(const FrameBuffers& frame, const SampleSource& source, std::size_t first,
                          std::size_t size, SampleBatch& batch) const {
  for (std::size_t i = first; i < first + size; ++i) {
    PathJob& job = batch.jobs[i];
    batch.paths[i] = {};
    batch.paths[i].lot = static_cast<std::uint8_t>(PhotonLots::ofPixel(job.x, job.y));
    batch.rays[i] = {};
    const double offset = toUnitFloat(hashCombine(hashCombine(job.x, job.y), seed_));
    const double share =
        frame.dial ? frame.dial->share(frame.tiles.tileAt(job.x, job.y), job.sample) : exact_;
    job.paired = source.pairs && !job.look && takesExact(job.sample, share, offset);
  }
}

/// First stage: C-rays on all CPU threads; the cones start on the device. False if it was given up.
bool SampleTaker::trace(const FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
                        SampleBatch& batch, bool mayGiveUp) {
  const std::size_t count = batch.jobs.size(), chunks = (count + kJobsOfChunk - 1) / kJobsOfChunk;
  const std::uint32_t width = frame.sums.width();
  batch.paths.resize(count);
  batch.rays.resize(count);
  batch.cones.resize(source.batched ? 1 : chunks);
  for (Cones& part : batch.cones) part.clear();
  prepareCaustics(source.caustics, batch.jobs, [](const PathJob& job) { return job.sample; });
  if (source.batched) {
    prepare(frame, source, 0, count, batch);
    const bool done =
        source.batched->trace(batch.jobs, width, batch.paths, batch.rays, batch.cones[0],
                              mayGiveUp ? giveUp_ : std::function<bool()>());
    if (!done) return false;
  }
  batch.missed.assign(source.batched ? 0 : chunks, 0);
  const RaysWait wait(batch.waits ? source.behind : nullptr, true);
  tbb::parallel_for(std::size_t{0}, source.batched ? 0 : chunks, [&](std::size_t chunk) {
    const std::size_t first = chunk * kJobsOfChunk, size = std::min(kJobsOfChunk, count - first);
    prepare(frame, source, first, size, batch);
    const std::uint64_t before = hccm::PageFetcher::missesHere();
    source.tracer->trace(std::span(batch.jobs).subspan(first, size), width,
                         static_cast<std::uint32_t>(first),
                         std::span(batch.paths).subspan(first, size),
                         std::span(batch.rays).subspan(first, size), batch.cones[chunk]);
    batch.missed[chunk] = hccm::PageFetcher::missesHere() != before;
  });
  if (source.behind != nullptr) dropMissed(batch);
  std::vector<RayCounts> rays(chunks);
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    const std::size_t first = chunk * kJobsOfChunk, size = std::min(kJobsOfChunk, count - first);
    for (const RayCounts& c : std::span(batch.rays).subspan(first, size)) rays[chunk].add(c);
  });
  for (const RayCounts& c : rays) rays_.add(c);
  batch.queries.clear();
  for (const Cones& part : batch.cones) {
    for (const ConeRequest& r : part.requests) {
      batch.queries.push_back({r.origin, r.tanHalf, r.direction, r.tmin, r.tmax, r.jitter,
                               r.shadow ? shaderio::kQueryShadow : 0u, 0u});
    }
  }
  batch.ticket.reset();
  batch.gathers = source.gathers;
  if (batch.queries.empty()) return true;
  if (batch.gathers != nullptr) batch.gathers->begin(batch.queries.size());
  batch.ticket = light.device()->submitGather(batch.queries);
  return true;
}

/// Second stage: the device's answers join their samples; where it had none rays go on.
void SampleTaker::finish(const SampleSource& source, VoxelLight& light, SampleBatch& batch) {
  if (!batch.ticket) return;
  const auto scale = static_cast<float>(light.cache()->scale());
  const std::uint64_t before = light.device()->statistics().deviceCones;
  const auto results = light.device()->finishGather(*batch.ticket);
  rays_.deviceCones += light.device()->statistics().deviceCones - before;
  if (batch.gathers != nullptr) batch.gathers->end();
  std::vector<PathState> unknown;
  std::size_t next = 0;
  for (const Cones& part : batch.cones) {
    for (const ConeRequest& r : part.requests) {
      const shaderio::GatherResult& answer = results[next++];
      if (answer.transmittance < 0.0f) {
        unknown.push_back(part.paths[r.path]);
        continue;
      }
      PathSample& path = batch.paths[r.job];
      const vec3 passed = r.background * answer.transmittance;
      path.guess += r.weight * answer.radiance * scale + passed;
      if (r.direct) path.direct += passed;
    }
  }
  batch.ticket.reset();
  resume(source, unknown, batch);
}

/// Paths of a batch whose cones did not know go on by rays.
void SampleTaker::resume(const SampleSource& source, std::span<const PathState> paths,
                         SampleBatch& batch) {
  const RaysWait wait(source.behind, true);
  std::vector<PathSample> samples(paths.size());
  std::vector<RayCounts> counts(paths.size());
  for (std::size_t i = 0; i < paths.size(); ++i) samples[i].lot = batch.paths[paths[i].job].lot;
  prepareCaustics(source.caustics, paths, [](const PathState& path) { return path.number; });
  if (source.batched) {
    source.batched->resume(paths, samples, counts);
  } else {
    const std::size_t chunks = (paths.size() + kJobsOfChunk - 1) / kJobsOfChunk;
    tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
      const std::size_t first = chunk * kJobsOfChunk,
                        size = std::min(kJobsOfChunk, paths.size() - first);
      source.tracer->resume(paths.subspan(first, size), std::span(samples).subspan(first, size),
                            std::span(counts).subspan(first, size));
    });
  }
  for (std::size_t i = 0; i < paths.size(); ++i) {
    PathSample& path = batch.paths[paths[i].job];
    path.guess += samples[i].common + samples[i].guess;
    path.direct += samples[i].direct;
    path.photonNoise += samples[i].photonNoise;
    batch.rays[paths[i].job].add(counts[i]);
    rays_.add(counts[i]);
  }
}

/// Third stage: the samples enter the frame.
void SampleTaker::merge(FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
                        SampleBatch& batch) {
  finish(source, light, batch);
  mergeJobs(frame, batch, !interactive_ && !source.batched);
  if (interactive_) {
    for (const std::uint32_t tile : batch.finishedTiles) rateTile(frame, tile);
  }
  batch.jobs.clear();
  batch.units.clear();
  batch.isVoid.clear();
  batch.waits = false;
  batch.looks = 0;
  batch.finishedTiles.clear();
}

bool SampleTaker::takeUnits(const FrameBuffers& frame, const SampleSource& source,
                            VoxelLight& light, std::span<const TileUnit> units,
                            const std::function<bool()>& keepGoing, TakenSamples& out) {
  SampleBatch batches[2];
  const RayCounts before = rays_;
  const std::size_t most = wanted(source, std::size_t{frame.sums.width()} * frame.sums.height());
  const auto keep = [&](SampleBatch& batch) {
    finish(source, light, batch);
    for (std::size_t i = 0; i < batch.jobs.size(); ++i) out.samples.push_back(takenOf(batch, i));
    batch.jobs.clear();
  };
  bool whole = true;
  std::size_t next = 0;
  for (std::size_t i = 0; whole && next < units.size(); ++i) {
    SampleBatch& batch = batches[i % 2];
    while (next < units.size() && batch.jobs.size() < most) {
      const TileUnit& unit = units[next++];
      addJobs(frame.tiles.tiles()[unit.tile], unit, nullptr, batch);
    }
    whole = keepGoing() && trace(frame, source, light, batch, true);
    if (!whole) batch.jobs.clear();
    keep(batches[(i + 1) % 2]);
    if (source.batched) keep(batch);  // there is no room for two
  }
  for (SampleBatch& batch : batches) keep(batch);
  out.rays = rays_.since(before);
  rays_ = before;
  if (!whole) out = {};
  return whole;
}

void SampleTaker::add(FrameBuffers& frame, std::span<const TileUnit> units,
                      const TakenSamples& taken) {
  std::size_t i = 0;
  for (const TileUnit& unit : units) {
    eachPixel(frame.tiles.tiles()[unit.tile], unit, [&](std::uint32_t x, std::uint32_t y) {
      const TakenSample& sample = taken.samples[i++];
      addSample(frame, x, y, unit.sample, sample);
      if (frame.dial) frame.dial->add(unit.tile, sample.paired, sample.rays);
    });
    frame.tiles.cameBack(unit);
    if (interactive_) rateTile(frame, unit.tile);
  }
  rays_.add(taken.rays);
}

}  // namespace trex
