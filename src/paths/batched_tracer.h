// Paths of a mesh in pages that does not fit in memory: rays wait for pages, not threads.
//
// A path goes through the stages of PathTracer as far as the pages that are there go; then its rays
// wait, each in the queue of the nearest page that it needs, and the thread takes other rays. When
// a page has been loaded all rays of its queue meet it, and go on [Pharr et al. 1997; Son and Yoon
// 2017]. Samples have the bits of PathTracer::trace(): what a ray meets does not depend on what was
// there when, and a path adds up in its own order.
//
// Rays towards lights wait as well, through glass, alpha and media too: there the record of a path
// has a second part, with the question. What is rare is not put off but waited for: the short rays
// that leave a smooth surface, those of shadow cones, and emitters that media see through glass.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "src/paths/page_rounds.h"
#include "src/paths/path_tracer.h"
#include "src/paths/waiting_path.h"

namespace trex {

class BatchedTracer {
 public:
  /// All of these must outlive it. The scene has a mesh in pages.
  /// `record` may be null.
  BatchedTracer(const PathTracer& tracer, const RayScene& rays, LoadChoice& choice,
                TrafficRecord* record = nullptr);
  /// Memory of a path under way in a scene, bytes, without its sample.
  static std::uint64_t bytesAPath(const Scene& scene);

  /// As PathTracer::trace(), with all threads of the calling oneTBB arena. All jobs are under way
  /// at once: bytesAPath() each. Cone requests have the order of jobs. `giveUp`, asked all the time
  /// by all threads, says whether to leave it; false if it did: nothing that is there is of use
  /// then.
  bool trace(std::span<const PathJob> jobs, std::uint32_t width, std::span<PathSample> samples,
             std::span<RayCounts> counts, Cones& cones, const std::function<bool()>& giveUp = {});
  /// As PathTracer::resume(), in the same way.
  void resume(std::span<const PathState> paths, std::span<PathSample> samples,
              std::span<RayCounts> counts);
  PageTrafficReport report() const { return report_; }

 private:
  struct Worker;
  struct Batch;
  bool run(Batch& batch, std::size_t paths, Cones& cones, const std::function<bool()>& giveUp);

  const PathTracer& tracer_;
  const RayScene& rays_;
  LoadChoice& choice_;
  TrafficRecord* record_;
  PageTrafficReport report_;
};

}  // namespace trex
