#include "src/crays/ray_scene.h"

#include <array>

#include "src/core/error.h"
#include "src/crays/ray_scene_impl.h"
#include "src/crays/ray_scene_parts.h"
#include "src/crays/reading_pages.h"

namespace trex {
namespace {

static_assert(RayScene::kWorldMesh == RTC_INVALID_GEOMETRY_ID,
              "Embree's instance id is that of our hits");

void boundsCallback(const RTCBoundsFunctionArguments* args) {
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  vec3 lower, upper;
  traced.mesh->bounds(lower, upper);
  const double margin = 2.0 * traced.mesh->step() + traced.slack;  // see hccmesh.h, "watertight"
  const dvec3 origin = traced.isShared ? dvec3(0.0) : traced.mesh->gridOrigin();
  lower = vec3(origin + dvec3(lower) - margin), upper = vec3(origin + dvec3(upper) + margin);
  RTCBounds& b = *args->bounds_o;
  b.lower_x = lower.x, b.lower_y = lower.y, b.lower_z = lower.z;
  b.upper_x = upper.x, b.upper_y = upper.y, b.upper_z = upper.z;
}

void takeHit(const RTCIntersectFunctionNArguments* args, TraceContext& context,
             std::uint32_t instance, const hccm::Hit& hit) {
  auto& rayHit = *reinterpret_cast<RTCRayHit*>(args->rayhit);
  context.best = {hit.u, hit.v, hit.t, instance, hit.cluster, hit.triangle};
  rayHit.ray.tfar = context.far = hit.t;
  rayHit.hit.geomID = args->geomID;
  rayHit.hit.primID = args->primID;
  rayHit.hit.instID[0] = args->context->instID[0];
}

void intersectCallback(const RTCIntersectFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  if (context.hides(traced)) return;
  if (context.waits != nullptr) return meetWithoutWaiting(args, traced, context);
  context.prepare(*traced.mesh, traced, reinterpret_cast<RTCRayHit*>(args->rayhit)->ray);
  const std::uint32_t instance = context.instanceOf(traced);
  hccm::Hit hit = bestFor(context, instance);
  if (traced.mesh->intersect(context.prepared, hit)) takeHit(args, context, instance, hit);
}

void occludedCallback(const RTCOccludedFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  if (context.hides(traced)) return;
  auto& ray = *reinterpret_cast<RTCRay*>(args->ray);
  context.prepare(*traced.mesh, traced, ray);
  if (traced.mesh->occluded(context.prepared)) ray.tfar = -kInfinity;
}

void groupBoundsCallback(const RTCBoundsFunctionArguments* args) {
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  const hccm::PageGroup& g = traced.paged->table().groups[args->primID];
  const auto margin = static_cast<float>(traced.slack);
  RTCBounds& b = *args->bounds_o;
  b.lower_x = g.lower[0] - margin, b.lower_y = g.lower[1] - margin, b.lower_z = g.lower[2] - margin;
  b.upper_x = g.upper[0] + margin, b.upper_y = g.upper[1] + margin, b.upper_z = g.upper[2] + margin;
}

void intersectGroupCallback(const RTCIntersectFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  RTCRay& ray = reinterpret_cast<RTCRayHit*>(args->rayhit)->ray;
  if (context.failed) return;
  if (context.waits != nullptr) return meetWithoutWaiting(args, traced, context);
  context.prepare(*traced.paged, traced, ray);
  hccm::Hit hit = bestFor(context, traced.instance);
  try {
    if (!traced.paged->comes(args->primID, context.pin)) {
      context.missed = true;
      ray.tfar = -kInfinity;
    } else if (traced.paged->intersect(args->primID, context.prepared, hit, context.pin))
      takeHit(args, context, traced.instance, hit);
  } catch (...) {
    context.failed = std::current_exception();
    ray.tfar = -kInfinity;  // ends the search
  }
}

void occludedGroupCallback(const RTCOccludedFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const Traced& traced = *static_cast<const Traced*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  auto& ray = *reinterpret_cast<RTCRay*>(args->ray);
  context.prepare(*traced.paged, traced, ray);
  try {
    if (!traced.paged->comes(args->primID, context.pin) ||
        traced.paged->occluded(args->primID, context.prepared, context.pin))
      ray.tfar = -kInfinity;
  } catch (...) {
    context.failed = std::current_exception();
    ray.tfar = -kInfinity;
  }
}

bool countMemory(void* counter, ssize_t bytes, bool) {
  static_cast<std::atomic<std::int64_t>*>(counter)->fetch_add(bytes, std::memory_order_relaxed);
  return true;
}

void check(RTCDevice device, const char* what) {
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE)
    fail(ExitCode::kMemoryOrDevice, "Embree: {} failed ({}){}", what,
         error == RTC_ERROR_OUT_OF_MEMORY ? "out of memory" : "error",
         error == RTC_ERROR_OUT_OF_MEMORY ? "; lower --precision or the scene's size" : "");
}

// What a mesh is to a scene: one primitive, for it has a hierarchy of its own; of a mesh in pages,
// one a group.
void attachMesh(RTCDevice device, RTCScene scene, Traced& traced, unsigned id) {
  const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  check(device, "making a geometry");
  const bool paged = traced.paged != nullptr;
  rtcSetGeometryUserPrimitiveCount(geometry, paged ? traced.paged->groupCount() : 1);
  rtcSetGeometryUserData(geometry, &traced);
  rtcSetGeometryBoundsFunction(geometry, paged ? groupBoundsCallback : boundsCallback, nullptr);
  rtcSetGeometryIntersectFunction(geometry, paged ? intersectGroupCallback : intersectCallback);
  rtcSetGeometryOccludedFunction(geometry, paged ? occludedGroupCallback : occludedCallback);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(scene, geometry, id);
  rtcReleaseGeometry(geometry);
  check(device, "attaching a mesh");
}

RTCScene newScene(RTCDevice device) {
  const RTCScene scene = rtcNewScene(device);
  check(device, "making a scene");
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  return scene;
}

}  // namespace

void RayScene::Impl::place(const Scene& scene) {
  for (const Parts::Placed& p : parts.placed) {
    const SharedPlace place = placeOf(scene, parts, p);
    Placement& made = placements.emplace_back();
    if (!Placement::make(place.toRender, place.object, made)) {
      fail(ExitCode::kInput, "{}: instance '{}' is flat or has a transform that is not finite",
           scene.source, scene.instances[p.instance].name);
    }
  }
}

void RayScene::Impl::attachInstance(std::size_t id) {
  const RTCGeometry geometry = rtcNewGeometry(top.device, RTC_GEOMETRY_TYPE_INSTANCE);
  check(top.device, "making an instance");
  rtcSetGeometryInstancedScene(geometry, meshScenes[parts.placed[id].mesh].scene);
  const mat4 matrix(placements[id].toRender);
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, &matrix[0][0]);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(top.scene, geometry, static_cast<unsigned>(id));
  rtcReleaseGeometry(geometry);
  check(top.device, "attaching an instance");
}

/// Meshes that are worth their memory twice, the smallest first. Leaves count, not triangles: those
/// of small parts and large triangles are not full.
void RayScene::Impl::expandSmall() {
  std::vector<hccm::Mesh*> meshes{&parts.world};
  for (hccm::Mesh& mesh : parts.shared) meshes.push_back(&mesh);
  std::ranges::stable_sort(meshes, {},
                           [](const hccm::Mesh* mesh) { return mesh->triangleCount(); });
  std::uint64_t leaves = 0;
  for (hccm::Mesh* mesh : meshes) {
    for (std::uint32_t i = 0; i < mesh->clusterCount() && leaves <= RayScene::kExpandedLeaves; ++i)
      leaves += mesh->clusterLeafCount(i);
    if (leaves > RayScene::kExpandedLeaves) break;
    mesh->expand();
  }
}

void RayScene::Impl::build(const Scene& scene) {
  place(scene);
  expandSmall();
  measure();
  if (worldAlone()) return;  // the world's own hierarchy is all there is
  top.device = rtcNewDevice(nullptr);
  if (!top.device) fail(ExitCode::kMemoryOrDevice, "Embree: no device could be made");
  rtcSetDeviceMemoryMonitorFunction(top.device, countMemory, &embreeBytes);
  const double reach = 4.0 * approach.radius + glm::length(approach.centre);  // of origins
  for (std::size_t i = 0; i < placements.size(); ++i) {
    double& slack = shared[parts.placed[i].mesh].slack;
    slack = std::max(slack, placements[i].embreeSlack * (reach + placements[i].far));
  }
  for (std::size_t i = 0; i < parts.shared.size(); ++i) {
    meshScenes[i].scene = newScene(top.device);
    shared[i].mesh = &parts.shared[i];
    shared[i].isShared = true;
    attachMesh(top.device, meshScenes[i].scene, shared[i], 0);
    rtcCommitScene(meshScenes[i].scene);
    check(top.device, "building a hierarchy");
  }
  top.scene = newScene(top.device);
  for (std::size_t i = 0; i < placements.size(); ++i) attachInstance(i);
  const auto worldId = static_cast<unsigned>(placements.size());
  tracedWorld.mesh = &parts.world;
  tracedWorld.paged = parts.paged.get();
  tracedWorld.slack = worldPlacement.embreeSlack * reach;
  if (parts.paged || parts.world.clusterCount() > 0)
    attachMesh(top.device, top.scene, tracedWorld, worldId);
  rtcCommitScene(top.scene);
  check(top.device, "building a hierarchy");
  statistics.topLevelBytes +=
      static_cast<std::uint64_t>(std::max<std::int64_t>(0, embreeBytes.load()));
}

void RayScene::Impl::measure() {
  Statistics& s = statistics;
  const auto add = [&](const hccm::Mesh& mesh) {
    s.uniqueTriangles += mesh.triangleCount();
    s.clusters += mesh.clusterCount();
    s.meshBytes += mesh.bytes().size();
    s.topLevelBytes += mesh.topLevelBytes();
  };
  const hccm::Mesh& world = parts.world;
  add(world);
  s.triangles = world.triangleCount();
  for (const hccm::Mesh& mesh : parts.shared) add(mesh);
  vec3 lower, upper;
  if (world.triangleCount() > 0) {
    world.bounds(lower, upper);
    bounds.extend(Box3f{lower, upper});
  }
  if (parts.paged) measurePages(parts.paged->table());
  for (std::size_t i = 0; i < placements.size(); ++i) {
    const hccm::Mesh& mesh = parts.shared[parts.placed[i].mesh];
    s.triangles += mesh.triangleCount();
    mesh.bounds(lower, upper);
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 c((corner & 1) ? upper.x : lower.x, (corner & 2) ? upper.y : lower.y,
                    (corner & 4) ? upper.z : lower.z);
      bounds.extend(vec3(placements[i].toRender * glm::dvec4(c, 1.0)));
    }
  }
  if (!bounds.empty()) approach = {dvec3(bounds.centre()), 0.5 * glm::length(dvec3(bounds.size()))};
  s.instances = static_cast<std::uint64_t>(std::ranges::count_if(
      parts.placed, [](const auto& p) { return p.instance != Parts::kNoInstance; }));
}

hccm::PreparedRay RayScene::Impl::worldRay(const Query& query, float tnear, float tfar) const {
  hccm::PreparedRay ray = parts.world.prepare(worldPlacement.rayToMesh(
      query.start, query.direction, tnear, tfar, query.end, parts.world.step()));
  ray.hidden = visibility.hiddenObjects();
  return ray;
}

void RayScene::Impl::measurePages(const hccm::PageTable& table) {
  Statistics& s = statistics;
  s.triangles = s.uniqueTriangles = table.triangles;
  s.clusters = table.clusters();
  s.pages = table.pages.size();
  s.packedBytes = table.packedBytes();
  s.meshBytes = table.bytes();
  s.cacheBytes = parts.paged->cacheBytes();
  // The table's box is that of clusters: two cells wider than the vertices.
  const auto margin = static_cast<float>(2.0 * parts.paged->step());
  const auto corner = [](const float* p) { return vec3(p[0], p[1], p[2]); };
  if (table.triangles > 0)
    bounds.extend(Box3f{corner(table.lower) + margin, corner(table.upper) - margin});
}

RayScene::RayScene(const Scene& scene, Parts parts)
    : impl_(std::make_unique<Impl>(std::move(parts))) {
  impl_->build(scene);
  impl_->media = Media::make(scene, impl_->parts.renderOrigin);
  if (impl_->media) impl_->bounds.extend(impl_->media->bounds());
}
RayScene::RayScene(const Scene& scene, const Options& options)
    : RayScene(scene, makeParts(scene, options)) {}
RayScene::~RayScene() = default;

bool RayScene::intersect(const RayStart& start, const vec3& direction, float tnear,
                         const RayEnd& end, RayHit& hit) const {
  RayStart near = start;
  float tfar = end.distance;
  double shift;
  if (!impl_->visibility.clip(start.position, direction, tnear, tfar)) return false;
  if (!impl_->approach.bring(near.position, direction, tnear, tfar, shift)) return false;
  const Query query{near, direction, end};
  if (impl_->worldAlone()) {
    hccm::PreparedRay ray = impl_->worldRay(query, tnear, tfar);
    hccm::Hit h;
    if (!impl_->parts.world.intersect(ray, h)) return false;
    hit = {h.u, h.v, h.t, kWorldMesh, h.cluster, h.triangle};
  } else {
    TraceContext context(query, impl_->visibility, impl_->placements, impl_->worldPlacement);
    RTCRayHit rayHit;
    setRay(rayHit.ray, vec3(near.position), direction, tnear, tfar);
    rayHit.hit.geomID = rayHit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(impl_->top.scene, &context.embree, &rayHit);
    if (context.failed) readingPages([&] { std::rethrow_exception(context.failed); });
    if (context.missed || context.best.cluster == hccm::Hit::kNothing) return false;
    hit = context.best;
  }
  if (shift != 0.0) hit.t = static_cast<float>(hit.t + shift);
  return true;
}

bool RayScene::occluded(const RayStart& start, const vec3& direction, float tnear,
                        const RayEnd& end, hccm::Passages* passages) const {
  RayStart near = start;
  float tfar = end.distance;
  double shift;
  if (!impl_->visibility.clip(start.position, direction, tnear, tfar)) return false;
  if (!impl_->approach.bring(near.position, direction, tnear, tfar, shift)) return false;
  const Query query{near, direction, end};
  if (impl_->worldAlone()) {
    hccm::PreparedRay ray = impl_->worldRay(query, tnear, tfar);
    ray.passages = passages;
    return impl_->parts.world.occluded(ray);
  }
  TraceContext context(query, impl_->visibility, impl_->placements, impl_->worldPlacement);
  context.passages = passages;
  RTCRay ray;
  setRay(ray, vec3(near.position), direction, tnear, tfar);
  rtcOccluded1(impl_->top.scene, &context.embree, &ray);
  if (context.failed) readingPages([&] { std::rethrow_exception(context.failed); });
  return ray.tfar < 0.0f;
}

// Calls trace(numbers, prepared rays, shifts) for up to kTogether rays at a time that may meet
// something, and none(number) for the others.
template <typename Trace, typename None>
void RayScene::Impl::together(std::span<const RayQuery> rays, const Trace& trace,
                              const None& none) const {
  hccm::PreparedRay prepared[kTogether];
  std::size_t number[kTogether];
  double shift[kTogether];
  std::size_t count = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const RayQuery& ray = rays[i];
    RayStart near = ray.start;
    float tnear = ray.tnear, tfar = ray.end.distance;
    if (visibility.clip(near.position, ray.direction, tnear, tfar) &&
        approach.bring(near.position, ray.direction, tnear, tfar, shift[count])) {
      prepared[count] = worldRay({near, ray.direction, ray.end}, tnear, tfar);
      number[count++] = i;
    } else {
      none(i);
    }
    if (count < kTogether && i + 1 < rays.size()) continue;
    trace(std::span(prepared, count), number, shift);
    count = 0;
  }
}

void RayScene::intersect(std::span<const RayQuery> rays, std::span<RayHit> hits,
                         std::span<std::uint8_t> answers) const {
  if (!impl_->worldAlone()) {
    for (std::size_t i = 0; i < rays.size(); ++i)
      answers[i] = intersect(rays[i].start, rays[i].direction, rays[i].tnear, rays[i].end, hits[i]);
    return;
  }
  impl_->together(
      rays,
      [&](std::span<hccm::PreparedRay> prepared, const std::size_t* number, const double* shift) {
        std::array<hccm::Hit, Impl::kTogether> found;
        impl_->parts.world.intersect(prepared, std::span(found).first(prepared.size()));
        for (std::size_t k = 0; k < prepared.size(); ++k) {
          const hccm::Hit& h = found[k];
          const std::size_t i = number[k];
          answers[i] = h.cluster != hccm::Hit::kNothing;
          if (!answers[i]) continue;
          hits[i] = {h.u, h.v, h.t, kWorldMesh, h.cluster, h.triangle};
          if (shift[k] != 0.0) hits[i].t = static_cast<float>(h.t + shift[k]);
        }
      },
      [&](std::size_t i) { answers[i] = 0; });
}

void RayScene::occluded(std::span<const RayQuery> rays, std::span<std::uint8_t> answers) const {
  if (!impl_->worldAlone()) {
    for (std::size_t i = 0; i < rays.size(); ++i)
      answers[i] = occluded(rays[i].start, rays[i].direction, rays[i].tnear, rays[i].end);
    return;
  }
  impl_->together(
      rays,
      [&](std::span<hccm::PreparedRay> prepared, const std::size_t* number, const double*) {
        std::array<std::uint8_t, Impl::kTogether> blocked;
        impl_->parts.world.occluded(prepared, std::span(blocked).first(prepared.size()));
        for (std::size_t k = 0; k < prepared.size(); ++k) answers[number[k]] = blocked[k];
      },
      [&](std::size_t i) { answers[i] = 0; });
}

Surface RayScene::surface(const RayHit& hit) const {
  if (hit.instance == kWorldMesh && impl_->parts.paged) {
    const hccm::Triangle triangle =
        readingPages([&] { return impl_->parts.paged->triangle(hit.cluster, hit.triangle); });
    return makeSurface(triangle, impl_->worldPlacement, hit);
  }
  if (hit.instance == kWorldMesh)
    return makeSurface(impl_->parts.world.triangle(hit.cluster, hit.triangle),
                       impl_->worldPlacement, hit);
  const hccm::Mesh& mesh = impl_->parts.shared[impl_->parts.placed[hit.instance].mesh];
  return makeSurface(mesh.triangle(hit.cluster, hit.triangle), impl_->placements[hit.instance],
                     hit);
}

bool RayScene::inPlace(const RayHit& hit) const {
  return hit.instance == kWorldMesh ? !impl_->parts.paged : !impl_->placements[hit.instance].moved;
}

hccm::Triangle RayScene::triangle(const RayHit& hit) const {
  if (hit.instance == kWorldMesh) return impl_->parts.world.triangle(hit.cluster, hit.triangle);
  const hccm::Mesh& mesh = impl_->parts.shared[impl_->parts.placed[hit.instance].mesh];
  hccm::Triangle triangle = mesh.triangle(hit.cluster, hit.triangle);
  const int object = impl_->placements[hit.instance].object;
  if (object != kNone) triangle.object = static_cast<std::uint32_t>(object);
  return triangle;
}

RayExit RayScene::exit(const Surface& surface, const vec3& direction, bool front) {
  const float height = glm::dot(surface.geometricNormal, direction) * (front ? 1.0f : -1.0f);
  if (height >= surface.bend) return {};
  const vec3& lift = surface.lift[front ? 0 : 1];
  return {glm::length(lift) > 0.0f ? lift : vec3(0.0f), height >= 0.0f};
}

RayQuery RayExit::query(const RayStart& start) const {
  const float length = glm::length(lift);
  return {start, lift / length, 0.0f, length};
}

bool RayExit::settle(bool blocked, RayStart& start) const {
  if (blocked) return open;
  start = start.position + dvec3(lift);
  return true;
}

bool RayScene::leave(const Surface& surface, const vec3& direction, bool front,
                     RayStart& start) const {
  start = surface.leave();
  const RayExit way = exit(surface, direction, front);
  if (!way.asks()) return way.open;
  const RayQuery between = way.query(start);
  return way.settle(occluded(between.start, between.direction, between.tnear, between.end), start);
}

dvec3 RayScene::renderOrigin() const { return impl_->parts.renderOrigin; }
Box3f RayScene::bounds() const { return impl_->bounds; }
const Media* RayScene::media() const { return impl_->media.get(); }
RayScene::Statistics RayScene::statistics() const { return impl_->statistics; }
hccm::PageCache::Statistics RayScene::pageStatistics() const {
  if (!impl_->parts.paged) return {};
  return impl_->parts.paged->statistics();
}

std::uint64_t RayScene::missed() const {
  const hccm::PagedMesh* paged = impl_->parts.paged.get();
  return paged != nullptr && paged->fetcher() != nullptr ? paged->fetcher()->misses() : 0;
}
const RayScene::Parts& RayScene::parts() const { return impl_->parts; }
void RayScene::setVisibility(const Visibility& visibility) { impl_->visibility = visibility; }
const Visibility& RayScene::visibility() const { return impl_->visibility; }

}  // namespace trex
