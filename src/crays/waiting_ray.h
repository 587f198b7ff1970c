// A ray that waits for pages: what is known of it so far.
#pragma once

#include <cstdint>
#include <type_traits>

#include "hccmesh/hccmesh.h"
#include "src/crays/ray_scene.h"

namespace trex {

/// Plain data, a ray's own. It notes the nearest groups of clusters whose pages are not there, by
/// where it enters them; if there are more than it can hold it looks for those behind once it is
/// done with these. Begins with all values at their defaults.
struct WaitingRay {
  static constexpr std::uint32_t kNoPage = 0xffffffffu;
  static constexpr std::uint32_t kGroups = 6;
  struct Group {
    float entry = -kInfinity;  ///< t, not later than the ray is in the group's box
    std::uint32_t group = 0, page = 0;
    bool before(const Group& o) const {
      return entry != o.entry ? entry < o.entry : group < o.group;
    }
  };

  RayHit best = nothing();    ///< so far; its t is along the ray as Embree has it until `answered`
  Group groups[kGroups];      ///< whose pages were not there, nearest first
  Group done;                 ///< all groups up to this one were met, but for those above
  std::uint8_t count = 0;     ///< of groups
  bool more : 1 = true;       ///< there may be groups behind `done`
  bool answered : 1 = false;  ///< the answer is known
  bool blocked : 1 = false;   ///< of occludedHere(): something is there
  bool passed : 1 = false;    ///< of that: something that lets light pass was met (not if blocked)
  bool waited : 1 = false;    ///< it is counted among those that have waited

  bool hit() const { return best.cluster != hccm::Hit::kNothing; }
  /// The page that it waits for.
  std::uint32_t page() const { return groups[0].page; }

 private:
  static RayHit nothing() {
    RayHit hit;
    hit.instance = RayScene::kWorldMesh;
    hit.cluster = hit.triangle = hccm::Hit::kNothing;
    return hit;
  }
};
static_assert(std::is_trivially_copyable_v<WaitingRay> && sizeof(WaitingRay) <= 128);

}  // namespace trex
