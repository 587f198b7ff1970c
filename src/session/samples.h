// Samples of a frame: from units of its tiles to pixels, rays, and sums.
//
//   trace   C-rays of a batch of pixels on the CPU; the cones they ask for go to the device
//   merge   while the device answers the next batch is traced; then its answers are added, and the
//           samples enter the frame
#pragma once

#include <functional>
#include <memory>

#include "src/paths/path_tracer.h"
#include "src/session/frame_buffers.h"
#include "src/session/settings.h"
#include "src/session/voxel_light.h"

namespace trex {

/// What the samples of a frame read, besides the light.
struct SampleSource {
  std::unique_ptr<PathTracer> tracer;
  CausticMaps* caustics = nullptr;  ///< made ready for the samples to come; null where none is read
  bool pairs = false;               ///< the settings' share of samples is traced exactly too
};

struct SampleBatch;

/// One thread at a time; each call uses all of the calling oneTBB arena.
class SampleTaker {
 public:
  explicit SampleTaker(const RenderSettings& settings)
      : interactive_(settings.interactive), seed_(settings.seed), exact_(settings.exact) {}

  /// Takes samples in the order of the frame's tiles until none is left before their barrier, or
  /// keepGoing, asked before each batch, says no. Of the viewer's tiles at least one batch, and the
  /// coarsest picture of all, are taken in any case. Tiles near `pointer` come first: see
  /// TileScheduler.
  void take(FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
            const std::function<bool()>& keepGoing, vec2 pointer);

  const RayCounts& rays() const { return rays_; }
  void restoreRays(const RayCounts& rays) { rays_ = rays; }

 private:
  bool fill(FrameBuffers& frame, SampleBatch& batch) const;
  void trace(const FrameBuffers& frame, const SampleSource& source, VoxelLight& light,
             SampleBatch& batch);
  void merge(FrameBuffers& frame, VoxelLight& light, SampleBatch& batch);
  void adapt(double seconds, std::size_t cost);

  bool interactive_;
  std::uint32_t seed_;
  double exact_;
  std::uint32_t batchPixels_ = 2048;  ///< of the viewer: some milliseconds' worth
  RayCounts rays_;
};

}  // namespace trex
