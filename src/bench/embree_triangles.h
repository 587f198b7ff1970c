// A scene as Embree's own triangles, to measure against.
#pragma once

#include <atomic>
#include <cstdint>

#include "src/scene/scene.h"

struct RTCDeviceTy;
struct RTCSceneTy;

namespace trex {

/// All placements of all meshes, relative to `origin`, with Embree's robust flag. Rays are thread
/// safe.
class EmbreeTriangles {
 public:
  /// Throws Error(kMemoryOrDevice).
  EmbreeTriangles(const Scene& scene, const dvec3& origin, bool compact);
  ~EmbreeTriangles();
  EmbreeTriangles(const EmbreeTriangles&) = delete;
  EmbreeTriangles& operator=(const EmbreeTriangles&) = delete;

  /// The distance of the nearest hit; infinite if there is none.
  float intersect(const vec3& origin, const vec3& direction, float tfar) const;
  bool occluded(const vec3& origin, const vec3& direction, float tfar) const;
  std::uint64_t bytes() const;      ///< hierarchy and copies of the meshes
  std::uint64_t triangles() const;  ///< placed ones
  double buildSeconds() const { return buildSeconds_; }

 private:
  void addInstance(const Scene& scene, const Instance& instance, const dvec3& origin);

  std::atomic<std::int64_t> bytes_{0};
  std::uint64_t triangles_ = 0;
  double buildSeconds_ = 0.0;
  RTCDeviceTy* device_ = nullptr;
  RTCSceneTy* scene_ = nullptr;
};

}  // namespace trex
