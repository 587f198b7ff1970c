// Samples of a frame: from units of its tiles to pixels, rays, and sums.
//
//   trace   C-rays of a batch of pixels on the CPU; the cones they ask for go to the device
//   merge   while the device answers the next batch is traced; then its answers are added, and the
//           samples enter the frame
#pragma once

#include <functional>
#include <memory>
#include <span>

#include "src/paths/batched_tracer.h"
#include "src/paths/gather_plan.h"
#include "src/paths/path_tracer.h"
#include "src/session/frame_buffers.h"
#include "src/session/settings.h"
#include "src/session/taken_samples.h"
#include "src/session/voxel_light.h"

namespace trex {

/// What the samples of a frame read, besides the light.
struct SampleSource {
  std::unique_ptr<PathTracer> tracer;
  CausticMaps* caustics = nullptr;  ///< made ready for the samples to come; null where none is read
  /// Where pages do not fit in memory; else null, and the tracer's own way is taken.
  std::unique_ptr<BatchedTracer> batched;
  GatherPlan* gathers = nullptr;  ///< where what happens is recorded; may be null
  bool pairs = false;             ///< the settings' share of samples is traced exactly too
  /// A mesh whose pages come behind rays (hccm::PagedMesh::fetchBehind()); else null.
  const hccm::PagedMesh* behind = nullptr;
  /// Units that miss pages again and again wait for them; else later, as others may take them.
  bool waitsAtLast = true;
};

struct SampleBatch;

/// Paths of a scene that may wait for pages at once in so many bytes, their samples included.
std::size_t pathsThatWait(const Scene& scene, std::uint64_t bytes);
/// Bytes that make room for so many of them.
std::uint64_t memoryOfPaths(const Scene& scene, std::uint64_t paths);

/// One thread at a time; each call uses all of the calling oneTBB arena.
class SampleTaker {
 public:
  SampleTaker(const Scene& scene, const RenderSettings& settings)
      : interactive_(settings.interactive),
        seed_(settings.seed),
        exact_(settings.exact),
        limit_(settings.seconds),
        mostWaiting_(pathsThatWait(scene, settings.rayMemory)) {
    waiting_ = limit_ > 0.0 ? 0 : mostWaiting_;
  }

  /// Takes samples in the order of the frame's tiles until none is left before their barrier, or
  /// keepGoing, asked before each batch, says no. Of the viewer's tiles at least one batch, and the
  /// coarsest picture of all, are taken in any case, but for tiles that lack pages which come
  /// behind: those are left until they are there. Tiles near `pointer` come first: see
  /// TileScheduler.
  void take(FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
            const std::function<bool()>& keepGoing, vec2 pointer);

  /// Takes samples of units of a frame that is swept and adds them to no frame: `out` gets them.
  /// False, and nothing, if keepGoing, asked before each batch, says no.
  bool takeUnits(const FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
                 std::span<const TileUnit> units, const std::function<bool()>& keepGoing,
                 TakenSamples& out);
  /// Adds samples that were taken so, by whomever: of `units`, which the frame's tiles have next,
  /// or have lent.
  void add(FrameBuffers& frame, std::span<const TileUnit> units, const TakenSamples& taken);

  /// Asked by all threads while paths wait for pages: whether to give up the samples under way,
  /// which are taken again later.
  void setGiveUp(std::function<bool()> ask) { giveUp_ = std::move(ask); }

  /// Paths of a batch that wait for pages, of a picture of so many pixels.
  std::size_t pathsAtOnce(std::size_t pixels) const {
    return std::min(mostWaiting_, waiting_ > 0 ? waiting_ : pixels);
  }
  const RayCounts& rays() const { return rays_; }
  void restoreRays(const RayCounts& rays) { rays_ = rays; }

 private:
  std::size_t wanted(const SampleSource& source, std::size_t pixels) const;
  bool fill(FrameBuffers& frame, const SampleSource& source, SampleBatch& batch) const;
  void prepare(const FrameBuffers& frame, const SampleSource& source, std::size_t first,
               std::size_t size, SampleBatch& batch) const;
  bool trace(const FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
             SampleBatch& batch, bool mayGiveUp);
  void adaptWaiting(double seconds, std::size_t jobs);
  void finish(const SampleSource& source, VoxelLight& light, SampleBatch& batch);
  void resume(const SampleSource& source, std::span<const PathState> paths, SampleBatch& batch);
  void merge(FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
             SampleBatch& batch);
  void adapt(double seconds, std::size_t cost);

  bool interactive_;
  std::uint32_t seed_;
  double exact_;
  double limit_;                      ///< seconds of the whole render, or 0
  std::size_t waiting_;               ///< of mostWaiting_, what the limit lets be
  std::size_t mostWaiting_;           ///< paths at once where pages do not fit in memory
  std::uint32_t batchPixels_ = 2048;  ///< of the viewer: some milliseconds' worth
  std::function<bool()> giveUp_;
  RayCounts rays_;
};

}  // namespace trex
