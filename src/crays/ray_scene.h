// The scene as C-rays see it: HCCMeshes under an Embree top level.
//
// "Render space" is metres relative to renderOrigin (the centre of the scene's bounds), single
// precision: what the camera, the integrator, the ASVO and the device use. Meshes placed once are
// merged into one HCCMesh whose grid origin is renderOrigin; a mesh placed several times is an
// HCCMesh of its own under Embree instances (unless all placements together are small, or one is
// flat: these are merged too). Of meshes that are not merged, a mirrored placement keeps glTF's
// front side. Texture coordinates are stored only where the material has a texture.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "hccmesh/hccmesh.h"
#include "hccmesh/page_cache.h"
#include "src/crays/media.h"
#include "src/crays/visibility.h"
#include "src/scene/scene.h"

namespace trex {

/// A hit; 24 bytes. `instance` is kWorldMesh for the merged mesh.
struct RayHit {
  float t = kInfinity, u = 0.0f, v = 0.0f;
  std::uint32_t instance = 0, cluster = 0, triangle = 0;
};

/// A surface point decoded from a hit, in render space.
struct Surface {
  vec3 position;         ///< on the decoded triangle, more exact than origin + t * direction
  vec3 geometricNormal;  ///< unit, of the front side (counter-clockwise)
  vec3 shadingNormal;    ///< unit, interpolated if stored, same hemisphere as geometricNormal
  vec3 tangent;          ///< unit, along +u of the texture; zero where there is no texture map
  vec3 bitangent;        ///< unit, along +v of glTF's normal maps (up in the texture)
  vec2 texCoord;
  vec4 color;  ///< vertex colour, one if none
  std::uint32_t material, object;
  float error;  ///< metres: distance to leave the surface by, so that a new ray misses it

  /// Where a new ray along `direction` starts.
  vec3 leave(const vec3& direction) const {
    const float side = glm::dot(geometricNormal, direction) >= 0.0f ? 1.0f : -1.0f;
    return position + geometricNormal * (side * error);
  }
};

/// Whether a material reads any texture: texture coordinates are stored just for these.
bool usesTextures(const Material& material);

class RayScene {
 public:
  static constexpr std::uint32_t kWorldMesh = 0xffffffffu;

  struct Options {
    int precisionBits = 24;  ///< grid cells along the largest extent: 2^bits, 8..24
    std::uint64_t mergeTriangles =
        1024;  ///< a mesh is merged if its placements have no more in all
  };
  struct Statistics {
    std::uint64_t triangles = 0, uniqueTriangles = 0, clusters = 0, instances = 0;
    std::uint64_t meshBytes = 0,
                  topLevelBytes = 0;  ///< HCCMesh buffers; hierarchies above clusters
    std::uint64_t pages = 0, packedBytes = 0, cacheBytes = 0;  ///< of a paged mesh; limit
  };

  /// The meshes that rays meet and where they stand: all that is costly to make of a scene.
  struct Parts {
    /// A shared mesh that an instance places.
    struct Placed {
      std::uint32_t instance = 0;  ///< index into Scene::instances
      std::uint32_t mesh = 0;      ///< index into shared
    };
    dvec3 renderOrigin{0.0};
    hccm::Mesh world;                ///< the merged meshes, in render space
    std::vector<hccm::Mesh> shared;  ///< those that are placed several times, in their own space
    std::vector<Placed> placed;      ///< by the instance id of hits
    /// Instead of `world`, which is empty then: a mesh of pages on disk, in render space.
    std::unique_ptr<hccm::PagedMesh> paged;
  };

  /// Compresses the meshes of a scene. Throws Error(kInput) for a mesh that can't be compressed.
  static Parts makeParts(const Scene& scene, const Options& options);

  /// Builds the Embree scene of HCCMeshes made before of the same scene, whose mesh arrays may be
  /// empty. Hits and surfaces have the same bits as before. Throws Error(kInput) for a placement
  /// that rays can't be brought to, Error(kMemoryOrDevice) if Embree fails.
  RayScene(const Scene& scene, Parts parts);
  /// makeParts() and the Embree scene.
  RayScene(const Scene& scene, const Options& options);
  explicit RayScene(const Scene& scene) : RayScene(scene, Options{}) {}
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  /// Nearest hit in [tnear, tfar]; direction unit length, everything finite but tfar. A negative
  /// tnear counts as 0. On equal t the lower (instance, cluster, triangle) wins. Thread safe.
  /// This and the next two throw Error(kInput) if a page of a paged mesh can't be read.
  bool intersect(const vec3& origin, const vec3& direction, float tnear, float tfar,
                 RayHit& hit) const;
  /// Whether anything lies in [tnear, tfar]. Thread safe.
  bool occluded(const vec3& origin, const vec3& direction, float tnear, float tfar) const;
  /// Decodes a hit. Thread safe.
  Surface surface(const RayHit& hit) const;

  dvec3 renderOrigin() const;
  Box3f bounds() const;  ///< render space, of meshes and media
  /// The scene's media; null if it has none.
  const Media* media() const;
  Statistics statistics() const;
  /// What the pages did so far; all zero without a paged mesh.
  hccm::PageCache::Statistics pageStatistics() const;
  const Parts& parts() const;

  /// What rays see from now on. Not to be called while rays are traced. bounds() stays that of all.
  void setVisibility(const Visibility& visibility);
  const Visibility& visibility() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace trex
