// What a RayScene is made of, and what a ray carries through Embree. Private to ray_scene*.cpp.
#pragma once

#include <embree3/rtcore.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "src/crays/ray_scene.h"
#include "src/crays/ray_scene_surface.h"
#include "src/crays/waiting_ray.h"

namespace trex {

// Embree's handles, released with their owner.
struct Handle {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  Handle() = default;
  Handle(Handle&& other) noexcept
      : device(std::exchange(other.device, nullptr)), scene(std::exchange(other.scene, nullptr)) {}
  Handle& operator=(Handle&&) = delete;
  ~Handle() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

// A ray as it is asked for. Embree has it in single precision, to cull by.
struct Query {
  const RayStart& start;
  const vec3& direction;
  const RayEnd& end;
};

// A mesh as Embree's geometry knows it.
struct Traced {
  const hccm::Mesh* mesh = nullptr;
  const hccm::PagedMesh* paged = nullptr;         // or this
  std::uint32_t instance = RayScene::kWorldMesh;  // unless Embree has an instance of it
  bool isShared = false;                          // it has
  double slack = 0.0;                             // mesh units: what Embree's rays may be off
};

// What callbacks find behind Embree's context: the best hit, and the ray as prepared for the mesh
// that was visited last, so that it is prepared once a mesh and not once a cluster.
struct TraceContext {
  RTCIntersectContext embree;
  Query query;
  std::uint32_t preparedFor;
  bool isPrepared = false;
  float far;  // Embree's tfar that `prepared` knows of
  hccm::PreparedRay prepared;
  RayHit best;
  const std::uint8_t* hidden;  // by object; null if every object is seen
  hccm::Passages* passages = nullptr;
  const Placement* placements;
  const Placement* world;
  hccm::PagedMesh::Pin pin;   // the page that was visited last
  std::exception_ptr failed;  // it can't pass through Embree
  bool missed = false;        // a page that is not there, of a ray that does not wait
  // Of a ray that does not wait for pages here (ray_scene_waiting.cpp): its own ends, since those
  // of Embree's ray are closer together. Null: pages are loaded.
  WaitingRay* waits = nullptr;
  bool shadow = false;  // asks whether anything is there
  float tnear = 0.0f, tfar = kInfinity;

  TraceContext(const Query& asked, const Visibility& visibility,
               const std::vector<Placement>& placed, const Placement& worldPlacement)
      : query(asked),
        hidden(visibility.hiddenObjects()),
        placements(placed.data()),
        world(&worldPlacement) {
    rtcInitIntersectContext(&embree);
    best.instance = RayScene::kWorldMesh;
    best.cluster = best.triangle = hccm::Hit::kNothing;
  }
  std::uint32_t instanceOf(const Traced& traced) const {
    return traced.isShared ? embree.instID[0] : traced.instance;
  }
  // Whether an instance is of a hidden object; clusters of merged meshes see to themselves.
  bool hides(const Traced& traced) const {
    if (hidden == nullptr || !traced.isShared) return false;
    const int object = placements[embree.instID[0]].object;
    return object != kNone && hidden[static_cast<std::uint32_t>(object)] != 0;
  }
  template <typename AnyMesh>
  void prepare(const AnyMesh& mesh, const Traced& traced, const RTCRay& ray) {
    if (waits == nullptr)
      prepare(mesh, instanceOf(traced), ray.tnear, ray.tfar);
    else
      prepare(mesh, instanceOf(traced), tnear, tfar);
  }
  template <typename AnyMesh>
  void prepare(const AnyMesh& mesh, std::uint32_t instance, float from, float to) {
    if (!isPrepared || preparedFor != instance) {
      const Placement& placement = instance == RayScene::kWorldMesh ? *world : placements[instance];
      hccm::Ray local =
          placement.rayToMesh(query.start, query.direction, from, to, query.end, mesh.step());
      if (query.start.from.instance != instance) local.fromCluster = hccm::Hit::kNothing;
      if (query.end.on.instance != instance) local.toCluster = hccm::Hit::kNothing;
      prepared = mesh.prepare(local);
      if (placement.object == kNone) prepared.hidden = hidden;
      prepared.passages = passages;
      preparedFor = instance;
      isPrepared = true;
      far = to;
    } else if (far != to) {
      hccm::Mesh::setFar(prepared, to);  // another mesh has shortened it
      far = to;
    }
  }
};

// Stands in for the callbacks of rays that do not wait for pages: ray_scene_waiting.cpp.
void meetWithoutWaiting(const RTCIntersectFunctionNArguments* args, const Traced& traced,
                        TraceContext& context);

// What is best so far, as a mesh under `instance` sees it: on equal t the lower (instance, cluster,
// triangle) wins.
inline hccm::Hit bestFor(const TraceContext& context, std::uint32_t instance) {
  hccm::Hit hit;
  if (context.best.instance == instance) {
    hit.cluster = context.best.cluster;
    hit.triangle = context.best.triangle;
  } else if (instance > context.best.instance) {
    hit.cluster = hit.triangle = 0;
  }
  return hit;
}

inline void setRay(RTCRay& ray, const vec3& origin, const vec3& direction, float tnear,
                   float tfar) {
  ray.org_x = origin.x, ray.org_y = origin.y, ray.org_z = origin.z;
  ray.dir_x = direction.x, ray.dir_y = direction.y, ray.dir_z = direction.z;
  ray.tnear = tnear;
  ray.tfar = tfar;
  ray.time = 0.0f;
  ray.mask = 0xffffffffu;
  ray.id = ray.flags = 0;
}

// Far outside the scene single precision is coarser than the scene: the ray then starts closer.
struct Approach {
  dvec3 centre{0.0};
  double radius = 0.0;  // metres; of a sphere around the scene

  // Moves the origin forward, and the interval back. False if the ray can't meet the scene: it
  // passes by, goes away, or starts nowhere. Embree takes no origins beyond 1e18, and no negative
  // t.
  bool bring(dvec3& origin, const vec3& direction, float& tnear, float& tfar, double& along) const {
    along = 0.0;
    tnear = std::max(tnear, 0.0f);
    if (!trex::isFinite(vec3(origin))) return false;
    const dvec3 o = origin - centre, d(direction);
    if (isNear(o)) return tfar >= tnear;
    along = -glm::dot(o, d) / glm::dot(d, d) - 2.0 * radius / glm::length(d);
    if (!(along > 0.0) || !std::isfinite(along)) return false;
    origin = centre + (o + along * d);
    tnear = std::max(static_cast<float>(tnear - along), 0.0f);
    tfar = static_cast<float>(tfar - along);
    return tfar >= tnear && isNear(o + along * d);
  }
  bool isNear(const dvec3& o) const {
    return std::max({std::abs(o.x), std::abs(o.y), std::abs(o.z)}) <= 4.0 * radius;
  }
};

struct RayScene::Impl {
  explicit Impl(Parts p)
      : parts(std::move(p)), meshScenes(parts.shared.size()), shared(parts.shared.size()) {}

  std::atomic<std::int64_t> embreeBytes{0};  // outlives the handles
  Parts parts;
  Handle top;
  Placement worldPlacement;
  std::vector<Handle> meshScenes;  // by shared mesh
  std::vector<Traced> shared;      // by shared mesh
  Traced tracedWorld;
  std::vector<Placement> placements;  // by instance id
  Box3f bounds;
  Approach approach;
  Statistics statistics;
  Visibility visibility;
  std::unique_ptr<const Media> media;

  void build(const Scene& scene);
  /// Nothing but the merged mesh, in memory.
  bool worldAlone() const { return placements.empty() && !parts.paged; }
  bool advance(const RayQuery& query, WaitingRay& ray, bool shadow,
               const hccm::Passage* passages) const;
  hccm::PreparedRay worldRay(const Query& query, float tnear, float tfar) const;
  /// Rays that the world's own hierarchy answers together.
  static constexpr std::size_t kTogether = 16;
  template <typename Trace, typename None>
  void together(std::span<const RayQuery> rays, const Trace& trace, const None& none) const;

 private:
  void place(const Scene& scene);
  void expandSmall();
  void attachInstance(std::size_t id);
  void measure();
  void measurePages(const hccm::PageTable& table);
};

}  // namespace trex
