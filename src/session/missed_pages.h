// Units of tiles that met pages which are not there and come behind rays that do not wait
// (hccmesh/page_fetcher.h): they come to nothing, and are traced again.
#pragma once

#include "hccmesh/page_cache.h"
#include "src/session/sample_batch.h"

namespace trex {

/// Whether rays of a mesh wait for pages, while it lives; the other way after that.
class RaysWait {
 public:
  /// `mesh`: one that fetches behind; null: nothing happens.
  RaysWait(const hccm::PagedMesh* mesh, bool wait) : mesh_(mesh), wait_(wait) { set(wait_); }
  ~RaysWait() { set(!wait_); }
  RaysWait(const RaysWait&) = delete;
  RaysWait& operator=(const RaysWait&) = delete;

 private:
  void set(bool wait) const {
    if (mesh_ != nullptr) mesh_->setWaiting(wait);
  }
  const hccm::PagedMesh* mesh_;
  bool wait_;
};

/// Of a batch that was traced: units that missed pages are void, and so is what follows each in its
/// tile.
void dropMissed(SampleBatch& batch);
/// Such units are their tiles' next again, once what was asked for so far has come.
void putBack(TileScheduler& tiles, const hccm::PageFetcher& fetcher, const SampleBatch& batch);

}  // namespace trex
