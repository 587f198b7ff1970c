#include "src/crays/ray_scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/crays/ray_scene_surface.h"

namespace trex {
namespace {

static_assert(RayScene::kWorldMesh == RTC_INVALID_GEOMETRY_ID,
              "Embree's instance id is that of our hits");

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

// What callbacks find behind Embree's context: the best hit, and the ray as prepared for the mesh
// that was visited last, so that it is prepared once a mesh and not once a cluster.
struct TraceContext {
  RTCIntersectContext embree;
  std::uint32_t preparedFor;
  bool isPrepared = false;
  float far;  // Embree's tfar that `prepared` knows of
  hccm::PreparedRay prepared;
  RayHit best;

  TraceContext() {
    rtcInitIntersectContext(&embree);
    best.instance = RayScene::kWorldMesh;
    best.cluster = best.triangle = hccm::Hit::kNothing;
  }
  void prepare(const hccm::Mesh& mesh, const RTCRay& ray) {
    const std::uint32_t instance = embree.instID[0];
    if (!isPrepared || preparedFor != instance) {
      prepared = mesh.prepare({vec3(ray.org_x, ray.org_y, ray.org_z), ray.tnear,
                               vec3(ray.dir_x, ray.dir_y, ray.dir_z), ray.tfar});
      preparedFor = instance;
      isPrepared = true;
      far = ray.tfar;
    } else if (far != ray.tfar) {
      hccm::Mesh::setFar(prepared, ray.tfar);  // another mesh has shortened it
      far = ray.tfar;
    }
  }
};

void boundsCallback(const RTCBoundsFunctionArguments* args) {
  const auto& mesh = *static_cast<const hccm::Mesh*>(args->geometryUserPtr);
  vec3 lower, upper;
  mesh.clusterBounds(args->primID, lower, upper);
  RTCBounds& b = *args->bounds_o;
  b.lower_x = lower.x, b.lower_y = lower.y, b.lower_z = lower.z;
  b.upper_x = upper.x, b.upper_y = upper.y, b.upper_z = upper.z;
}

void intersectCallback(const RTCIntersectFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const auto& mesh = *static_cast<const hccm::Mesh*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  auto& rayHit = *reinterpret_cast<RTCRayHit*>(args->rayhit);
  context.prepare(mesh, rayHit.ray);
  const std::uint32_t instance = args->context->instID[0];
  // On equal t the lower (instance, cluster, triangle) wins.
  hccm::Hit hit;
  if (context.best.instance == instance) {
    hit.cluster = context.best.cluster;
    hit.triangle = context.best.triangle;
  } else if (instance > context.best.instance) {
    hit.cluster = hit.triangle = 0;
  }
  if (!mesh.intersect(args->primID, context.prepared, hit)) return;
  context.best = {hit.t, hit.u, hit.v, instance, hit.cluster, hit.triangle};
  rayHit.ray.tfar = context.far = hit.t;
  rayHit.hit.geomID = args->geomID;
  rayHit.hit.primID = args->primID;
  rayHit.hit.instID[0] = instance;
}

void occludedCallback(const RTCOccludedFunctionNArguments* args) {
  if (args->N != 1 || args->valid[0] == 0) return;
  const auto& mesh = *static_cast<const hccm::Mesh*>(args->geometryUserPtr);
  auto& context = *reinterpret_cast<TraceContext*>(args->context);
  auto& ray = *reinterpret_cast<RTCRay*>(args->ray);
  context.prepare(mesh, ray);
  if (mesh.occluded(args->primID, context.prepared)) ray.tfar = -kInfinity;
}

void setRay(RTCRay& ray, const vec3& origin, const vec3& direction, float tnear, float tfar,
            double shift) {
  ray.org_x = origin.x, ray.org_y = origin.y, ray.org_z = origin.z;
  ray.dir_x = direction.x, ray.dir_y = direction.y, ray.dir_z = direction.z;
  if (shift != 0.0) {
    tnear = static_cast<float>(tnear - shift);
    tfar = static_cast<float>(tfar - shift);
  }
  ray.tnear = std::max(tnear, 0.0f);  // Embree knows no negative t
  ray.tfar = tfar;
  ray.time = 0.0f;
  ray.mask = 0xffffffffu;
  ray.id = ray.flags = 0;
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

// Far outside the scene single precision is coarser than the scene: the ray then starts closer.
struct Approach {
  dvec3 centre{0.0};
  double radius = 0.0;  // metres; of a sphere around the scene

  // Moves the origin forward and says by how much.
  double bring(vec3& origin, const vec3& direction) const {
    const dvec3 o = dvec3(origin) - centre, d(direction);
    if (std::max({std::abs(o.x), std::abs(o.y), std::abs(o.z)}) <= 4.0 * radius) return 0.0;
    const double along = -glm::dot(o, d) / glm::dot(d, d) - 2.0 * radius / glm::length(d);
    if (!(along > 0.0) || !std::isfinite(along)) return 0.0;
    origin = vec3(dvec3(origin) + along * d);
    return along;
  }
};

// Clusters of a mesh as primitives of a scene.
void attachMesh(RTCDevice device, RTCScene scene, const hccm::Mesh& mesh, unsigned id) {
  const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  check(device, "making a geometry");
  rtcSetGeometryUserPrimitiveCount(geometry, mesh.clusterCount());
  rtcSetGeometryUserData(geometry, const_cast<hccm::Mesh*>(&mesh));
  rtcSetGeometryBoundsFunction(geometry, boundsCallback, nullptr);
  rtcSetGeometryIntersectFunction(geometry, intersectCallback);
  rtcSetGeometryOccludedFunction(geometry, occludedCallback);
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

bool usesTextures(const Material& m) {
  for (const Texture* t :
       {&m.baseColorTexture, &m.metallicRoughnessTexture, &m.normalTexture, &m.emissiveTexture,
        &m.transmissionTexture, &m.specularTexture, &m.specularColorTexture})
    if (t->present()) return true;
  return false;
}

// Only what the scene uses is stored.
hccm::Part partOf(const Scene& scene, const Mesh& mesh) {
  hccm::Part part;
  part.positions = mesh.positions;
  part.triangles = mesh.triangles;
  part.normals = mesh.normals;
  part.colors = mesh.colors;
  if (usesTextures(scene.materials[static_cast<std::size_t>(mesh.material)]))
    part.texCoords = mesh.texCoords;
  part.material = static_cast<std::uint32_t>(mesh.material);
  return part;
}

dmat4 translation(const dvec3& v) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(v, 1.0);
  return m;
}

bool isFinite(const dmat4& m) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!std::isfinite(m[c][r])) return false;
  return true;
}

}  // namespace

struct RayScene::Impl {
  // A mesh that is placed several times, and its scene.
  struct Shared {
    explicit Shared(hccm::Mesh m) : mesh(std::move(m)) {}
    hccm::Mesh mesh;
    Handle handle;
  };
  struct Placed {
    const Shared* shared;
    Placement placement;
  };

  std::atomic<std::int64_t> embreeBytes{0};  // outlives the handles
  Handle top;
  std::unique_ptr<hccm::Mesh> world;
  Placement worldPlacement;
  std::vector<std::unique_ptr<Shared>> shared;
  std::vector<Placed> placed;  // by instance id
  dvec3 renderOrigin{0.0};
  Box3f bounds;
  Approach approach;
  Statistics statistics;

  void build(const Scene& scene, const Options& options);

 private:
  std::vector<hccm::Part> worldParts_;

  void addToWorld(const Scene& scene, const Instance& instance);
  void addShared(const Scene& scene, const Options& options, std::span<const int> placements);
  void attachInstance(const Placed& instance, unsigned id);
  void measure();
};

void RayScene::Impl::addToWorld(const Scene& scene, const Instance& instance) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  hccm::Part part = partOf(scene, mesh);
  part.object = static_cast<std::uint32_t>(instance.object);
  part.transform = translation(-renderOrigin) * instance.transform * translation(mesh.origin);
  if (isFinite(part.transform))
    worldParts_.push_back(part);
  else
    logWarning("instance '{}' has a transform that is not finite; it is left out", instance.name);
}

void RayScene::Impl::addShared(const Scene& scene, const Options& options,
                               std::span<const int> placements) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(scene.instances[placements[0]].mesh)];
  const hccm::Part part = partOf(scene, mesh);
  hccm::BuildOptions build;
  build.precisionBits = options.precisionBits;
  auto entry = std::make_unique<Shared>(hccm::Mesh::build({&part, 1}, build));
  if (entry->mesh.triangleCount() == 0) return;
  const dmat4 toMesh = translation(mesh.origin + entry->mesh.gridOrigin());
  bool used = false;
  for (int i : placements) {
    const Instance& instance = scene.instances[static_cast<std::size_t>(i)];
    Placed p{entry.get(), {}};
    if (Placement::make(translation(-renderOrigin) * instance.transform * toMesh,
                        entry->mesh.step(), instance.object, p.placement)) {
      placed.push_back(p);
      used = true;
    } else {
      addToWorld(scene, instance);  // flat: rays have no way into it, its triangles do
    }
  }
  if (used) shared.push_back(std::move(entry));
}

void RayScene::Impl::attachInstance(const Placed& instance, unsigned id) {
  const RTCGeometry geometry = rtcNewGeometry(top.device, RTC_GEOMETRY_TYPE_INSTANCE);
  check(top.device, "making an instance");
  rtcSetGeometryInstancedScene(geometry, instance.shared->handle.scene);
  const mat4 matrix(instance.placement.toRender);
  rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, &matrix[0][0]);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(top.scene, geometry, id);
  rtcReleaseGeometry(geometry);
  check(top.device, "attaching an instance");
}

void RayScene::Impl::build(const Scene& scene, const Options& options) {
  const auto start = std::chrono::steady_clock::now();
  const Box3d box = scene.bounds();
  if (!box.empty()) renderOrigin = box.centre();

  std::vector<std::vector<int>> placements(scene.meshes.size());
  for (std::size_t i = 0; i < scene.instances.size(); ++i)
    placements[static_cast<std::size_t>(scene.instances[i].mesh)].push_back(static_cast<int>(i));
  for (std::size_t m = 0; m < placements.size(); ++m) {
    const std::vector<int>& list = placements[m];
    const std::uint64_t triangles = scene.meshes[m].triangles.size();
    if (list.empty() || triangles == 0) continue;
    if (list.size() == 1 || triangles * list.size() <= options.mergeTriangles)
      for (int i : list) addToWorld(scene, scene.instances[static_cast<std::size_t>(i)]);
    else
      addShared(scene, options, list);
  }
  hccm::BuildOptions worldOptions;
  worldOptions.precisionBits = options.precisionBits;
  worldOptions.chooseOrigin = false;  // parts come in render space
  world = std::make_unique<hccm::Mesh>(hccm::Mesh::build(worldParts_, worldOptions));
  worldParts_ = {};
  Placement::make(dmat4(1.0), world->step(), -1, worldPlacement);
  worldPlacement.relativeError = 0x1p-20;  // no matrix between

  top.device = rtcNewDevice(nullptr);
  if (!top.device) fail(ExitCode::kMemoryOrDevice, "Embree: no device could be made");
  rtcSetDeviceMemoryMonitorFunction(top.device, countMemory, &embreeBytes);
  for (const std::unique_ptr<Shared>& s : shared) {
    s->handle.scene = newScene(top.device);
    attachMesh(top.device, s->handle.scene, s->mesh, 0);
    rtcCommitScene(s->handle.scene);
    check(top.device, "building a hierarchy");
  }
  top.scene = newScene(top.device);
  for (std::size_t i = 0; i < placed.size(); ++i)
    attachInstance(placed[i], static_cast<unsigned>(i));
  if (world->clusterCount() > 0)
    attachMesh(top.device, top.scene, *world, static_cast<unsigned>(placed.size()));
  rtcCommitScene(top.scene);
  check(top.device, "building a hierarchy");
  measure();
  statistics.buildSeconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void RayScene::Impl::measure() {
  Statistics& s = statistics;
  const auto add = [&](const hccm::Mesh& mesh) {
    s.uniqueTriangles += mesh.triangleCount();
    s.clusters += mesh.clusterCount();
    s.meshBytes += mesh.bytes().size();
  };
  add(*world);
  s.triangles = world->triangleCount();
  for (const std::unique_ptr<Shared>& m : shared) add(m->mesh);
  vec3 lower, upper;
  if (world->triangleCount() > 0) {
    world->bounds(lower, upper);
    bounds.extend(Box3f{lower, upper});
  }
  for (const Placed& p : placed) {
    s.triangles += p.shared->mesh.triangleCount();
    p.shared->mesh.bounds(lower, upper);
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 c((corner & 1) ? upper.x : lower.x, (corner & 2) ? upper.y : lower.y,
                    (corner & 4) ? upper.z : lower.z);
      bounds.extend(vec3(p.placement.toRender * glm::dvec4(c, 1.0)));
    }
  }
  if (!bounds.empty()) approach = {dvec3(bounds.centre()), 0.5 * glm::length(dvec3(bounds.size()))};
  s.instances = placed.size();
  s.topLevelBytes = static_cast<std::uint64_t>(std::max<std::int64_t>(0, embreeBytes.load()));
}

RayScene::RayScene(const Scene& scene, const Options& options) : impl_(std::make_unique<Impl>()) {
  try {
    impl_->build(scene, options);
  } catch (const std::invalid_argument& e) {
    fail(ExitCode::kInput, "{}: {}", scene.source, e.what());
  }
}
RayScene::~RayScene() = default;

bool RayScene::intersect(const vec3& origin, const vec3& direction, float tnear, float tfar,
                         RayHit& hit) const {
  TraceContext context;
  RTCRayHit rayHit;
  vec3 start = origin;
  const double shift = impl_->approach.bring(start, direction);
  setRay(rayHit.ray, start, direction, tnear, tfar, shift);
  rayHit.hit.geomID = rayHit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(impl_->top.scene, &context.embree, &rayHit);
  if (context.best.cluster == hccm::Hit::kNothing) return false;
  hit = context.best;
  if (shift != 0.0) hit.t = static_cast<float>(hit.t + shift);
  return true;
}

bool RayScene::occluded(const vec3& origin, const vec3& direction, float tnear, float tfar) const {
  TraceContext context;
  RTCRay ray;
  vec3 start = origin;
  const double shift = impl_->approach.bring(start, direction);
  setRay(ray, start, direction, tnear, tfar, shift);
  if (!(ray.tfar >= 0.0f)) return false;
  rtcOccluded1(impl_->top.scene, &context.embree, &ray);
  return ray.tfar < 0.0f;
}

Surface RayScene::surface(const RayHit& hit) const {
  if (hit.instance == kWorldMesh)
    return makeSurface(impl_->world->triangle(hit.cluster, hit.triangle), impl_->worldPlacement,
                       hit.u, hit.v);
  const Impl::Placed& p = impl_->placed[hit.instance];
  return makeSurface(p.shared->mesh.triangle(hit.cluster, hit.triangle), p.placement, hit.u, hit.v);
}

dvec3 RayScene::renderOrigin() const { return impl_->renderOrigin; }
Box3f RayScene::bounds() const { return impl_->bounds; }
RayScene::Statistics RayScene::statistics() const { return impl_->statistics; }

}  // namespace trex
