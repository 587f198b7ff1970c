#include "src/bench/embree_triangles.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <chrono>

#include "src/core/error.h"

namespace trex {
namespace {

void setRay(RTCRay& ray, const vec3& origin, const vec3& direction, float tfar) {
  ray.org_x = origin.x, ray.org_y = origin.y, ray.org_z = origin.z;
  ray.dir_x = direction.x, ray.dir_y = direction.y, ray.dir_z = direction.z;
  ray.tnear = 0.0f, ray.tfar = tfar, ray.time = 0.0f;
  ray.mask = 0xffffffffu, ray.id = ray.flags = 0;
}

}  // namespace

EmbreeTriangles::EmbreeTriangles(const Scene& scene, const dvec3& origin, bool compact) {
  const auto start = std::chrono::steady_clock::now();
  device_ = rtcNewDevice(nullptr);
  if (!device_) fail(ExitCode::kMemoryOrDevice, "Embree: no device could be made");
  rtcSetDeviceMemoryMonitorFunction(
      device_,
      [](void* counter, ssize_t bytes, bool) {
        static_cast<std::atomic<std::int64_t>*>(counter)->fetch_add(bytes);
        return true;
      },
      &bytes_);
  scene_ = rtcNewScene(device_);
  rtcSetSceneFlags(
      scene_, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST |
                                         (compact ? RTC_SCENE_FLAG_COMPACT : RTC_SCENE_FLAG_NONE)));
  for (const Instance& instance : scene.instances) addInstance(scene, instance, origin);
  rtcCommitScene(scene_);
  if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) {
    fail(ExitCode::kMemoryOrDevice, "Embree: building a hierarchy of triangles failed");
  }
  buildSeconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

EmbreeTriangles::~EmbreeTriangles() {
  rtcReleaseScene(scene_);
  rtcReleaseDevice(device_);
}

void EmbreeTriangles::addInstance(const Scene& scene, const Instance& instance,
                                  const dvec3& origin) {
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  const RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  void* p = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(vec3),
                                    mesh.positions.size());
  void* t = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                    sizeof(glm::uvec3), mesh.triangles.size());
  if (!p || !t) fail(ExitCode::kMemoryOrDevice, "Embree: no memory for a mesh");
  std::transform(mesh.positions.begin(), mesh.positions.end(), static_cast<vec3*>(p),
                 [&](const vec3& v) {
                   const glm::dvec4 at(dvec3(v) + mesh.origin, 1.0);
                   return vec3(dvec3(instance.transform * at) - origin);
                 });
  std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<glm::uvec3*>(t));
  rtcCommitGeometry(g);
  rtcAttachGeometry(scene_, g);
  rtcReleaseGeometry(g);
  triangles_ += mesh.triangles.size();
}

float EmbreeTriangles::intersect(const vec3& origin, const vec3& direction, float tfar) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit hit;
  setRay(hit.ray, origin, direction, tfar);
  hit.hit.geomID = hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_, &context, &hit);
  return hit.hit.geomID != RTC_INVALID_GEOMETRY_ID ? hit.ray.tfar : kInfinity;
}

bool EmbreeTriangles::occluded(const vec3& origin, const vec3& direction, float tfar) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray;
  setRay(ray, origin, direction, tfar);
  rtcOccluded1(scene_, &context, &ray);
  return ray.tfar < 0.0f;
}

std::uint64_t EmbreeTriangles::bytes() const {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, bytes_.load()));
}
std::uint64_t EmbreeTriangles::triangles() const { return triangles_; }

}  // namespace trex
