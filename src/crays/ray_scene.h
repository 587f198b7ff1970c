// The scene as C-rays see it: HCCMeshes under an Embree top level.
//
// "Render space" is metres relative to renderOrigin (the centre of the scene's bounds): what the
// camera, paths, the ASVO and the device use. Points that rays start from or end at are in
// double precision, all else is in single precision. Meshes placed once are
// merged into one HCCMesh whose grid origin is renderOrigin; a mesh placed several times is an
// HCCMesh of its own under Embree instances (unless all placements together are small, or one is
// flat: these are merged too). Of meshes that are not merged, a mirrored placement keeps glTF's
// front side. Texture coordinates are stored only where the material has a texture, those of set 1
// only where one reads them.
//
// One grid has 2^24 cells along the scene. What it is too coarse for (a cell is more than 2^-11 of
// a mesh's size or 2^-5 of its thickness, or, in scenes of more than a kilometre, than 2^-14 m and
// 2^-14 of its width) is merged by size and place into HCCMeshes with grids of their own; beside
// these, what is flat along an axis has one with its plane on it. A scene that needs none of them
// has just the one. (A mesh of pages has one grid, whatever lies in it.)
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "hccmesh/hccmesh.h"
#include "hccmesh/page_cache.h"
#include "src/crays/media.h"
#include "src/crays/visibility.h"
#include "src/scene/scene.h"

namespace trex {

/// A hit. `instance` is kWorldMesh for the merged mesh.
struct RayHit {
  double u = 0.0, v = 0.0;  ///< weights of the second and third corner, inside the triangle
  float t = kInfinity;
  std::uint32_t instance = 0, cluster = 0, triangle = 0;
};

/// A triangle as hits name it; none by default.
struct TriangleId {
  std::uint32_t instance = 0, cluster = 0xffffffffu, triangle = 0xffffffffu;
};

/// Where a ray starts, in render space. A ray that leaves a surface starts on it: it meets neither
/// the triangle that it leaves nor others in one plane with the start, so nothing is moved off.
struct RayStart {
  enum class On : std::uint8_t {
    kNothing,  ///< a point in space: a camera, a point of a medium
    kSurface,  ///< a point of a decoded triangle
    kSource,   ///< a point of a triangle as the scene has it, not rounded to the grid
  };
  dvec3 position{0.0};
  On on = On::kNothing;
  TriangleId from;  ///< that triangle

  RayStart() = default;
  RayStart(const dvec3& point, On where = On::kNothing) : position(point), on(where) {}
  RayStart(const vec3& point) : position(point) {}
};

/// Where a ray ends, unless it meets something before.
struct RayEnd {
  float distance;  ///< may be infinite
  /// A point of a light as the scene has it: surfaces in one plane with it, which are the light's
  /// own, are not met. `distance` is how far it is.
  std::optional<dvec3> point;

  TriangleId on;  ///< the triangle that the point is on; it is not met

  RayEnd(float metres) : distance(metres) {}
  RayEnd(float metres, const dvec3& place, const TriangleId& triangle = {})
      : distance(metres), point(place), on(triangle) {}
};

/// A ray as one of many.
struct RayQuery {
  RayStart start;
  vec3 direction{0.0f};
  float tnear = 0.0f;
  RayEnd end{kInfinity};
};

/// A surface point decoded from a hit, in render space.
struct Surface {
  /// On the decoded triangle: corners are exact, so what is lost is 2^-50 of the largest coordinate
  /// of triangle and scene.
  dvec3 position;
  vec3 geometricNormal;  ///< unit, of the front side (counter-clockwise)
  vec3 shadingNormal;    ///< unit, interpolated if stored, same hemisphere as geometricNormal
  vec3 tangent;          ///< unit, along +u of set 0; zero where there is no texture map
  vec3 bitangent;        ///< unit, along +v of glTF's normal maps (up in the texture)
  TexCoords texCoords;
  vec4 color;  ///< vertex colour, one if none
  std::uint32_t material, object;
  std::uint32_t instance, cluster, triangle;  ///< as in a RayHit
  /// From here to the smooth surface that the corners' normals speak of, where that stands out on
  /// the front and on the back; zero where it does not.
  vec3 lift[2];
  float bend;  ///< sine of the largest angle of a corner's normal to geometricNormal

  /// Where a ray starts that goes on through the surface.
  RayStart leave() const {
    RayStart start(position, RayStart::On::kSurface);
    start.from = {instance, cluster, triangle};
    return start;
  }
};

/// Where a ray starts that leaves a smooth surface, as far as no other ray need be asked for it:
/// RayScene::exit().
struct RayExit {
  /// From the triangle to the smooth surface that it stands for: the ray starts there if nothing is
  /// between. Zero: it starts on the triangle.
  vec3 lift{0.0f};
  bool open = true;  ///< else the triangle itself is in the way of a ray that starts on it

  bool asks() const { return lift != vec3(0.0f); }
  /// The ray that finds out. `start`: Surface::leave().
  RayQuery query(const RayStart& start) const;
  /// What it has found. False if the triangle is in the way.
  bool settle(bool blocked, RayStart& start) const;
};

struct WaitingRay;

class RayScene {
 public:
  static constexpr std::uint32_t kWorldMesh = 0xffffffffu;
  /// Small meshes are kept expanded as well (hccm::Mesh::expand), up to this many leaves in all,
  /// of up to 8 triangles: about 48 MiB.
  static constexpr std::uint64_t kExpandedLeaves = 1u << 17;

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
    /// Of a mesh that lies in render space where its grid origin is; its clusters know objects.
    static constexpr std::uint32_t kNoInstance = 0xffffffffu;
    /// A mesh that an instance places.
    struct Placed {
      std::uint32_t instance = 0;  ///< index into Scene::instances, or kNoInstance
      std::uint32_t mesh = 0;      ///< index into shared
    };
    dvec3 renderOrigin{0.0};
    hccm::Mesh world;                ///< the merged meshes, in render space
    std::vector<hccm::Mesh> shared;  ///< all others, in their own space
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

  /// Nearest hit in [tnear, end]; direction unit length, everything finite but the end. A negative
  /// tnear counts as 0. On equal t the lower (instance, cluster, triangle) wins. Thread safe.
  /// This and the next two throw Error(kInput) if a page of a paged mesh can't be read.
  bool intersect(const RayStart& start, const vec3& direction, float tnear, const RayEnd& end,
                 RayHit& hit) const;
  /// Whether anything lies in [tnear, end]. `passages`, by material of the scene, says what counts;
  /// null: everything. Thread safe.
  bool occluded(const RayStart& start, const vec3& direction, float tnear, const RayEnd& end,
                hccm::Passages* passages = nullptr) const;
  /// As the two above for each ray of a span, with the same bits. Neighbours in the span that go
  /// the same way are traced together. `hits`, `answers` (1 or 0: hit, or blocked): one a ray; a
  /// hit is written where there is one. Thread safe.
  void intersect(std::span<const RayQuery> rays, std::span<RayHit> hits,
                 std::span<std::uint8_t> answers) const;
  void occluded(std::span<const RayQuery> rays, std::span<std::uint8_t> answers) const;
  /// As intersect() and occluded(), as far as the pages that are there go: none is loaded. True
  /// once the answer is known: `ray.hit()`, `ray.blocked`. Else the ray waits for `ray.page()`; ask
  /// again, with the same query, when that has been there. The bits are those of the calls above,
  /// whatever was there when. Thread safe, a WaitingRay by itself.
  bool intersectHere(const RayQuery& query, WaitingRay& ray) const;
  /// `passages`: as hccm::Passages has them; null: everything blocks.
  bool occludedHere(const RayQuery& query, WaitingRay& ray,
                    const hccm::Passage* passages = nullptr) const;
  /// As intersectHere(), and then what surface() of a hit reads is there, too.
  bool meetHere(const RayQuery& query, WaitingRay& ray) const;
  /// The page that a ray waits for, of any of the three.
  std::uint32_t awaited(const WaitingRay& ray) const;
  /// The page that surface(hit) reads; WaitingRay::kNoPage if it is of a mesh in memory.
  std::uint32_t pageOf(const RayHit& hit) const;
  /// Whether that is there. By the time of the answer another thread may have changed that.
  bool surfaceIsHere(const RayHit& hit) const;
  /// Whether the mesh of a hit is in memory and lies in render space as it is; its triangle().
  /// Thread safe.
  bool inPlace(const RayHit& hit) const;
  hccm::Triangle triangle(const RayHit& hit) const;
  /// Decodes a hit. Thread safe.
  Surface surface(const RayHit& hit) const;
  /// Where a ray along `direction` starts that was scattered at a surface and leaves it on its
  /// front or its back (Bsdf::leavesFront). Close to the horizon of a triangle that stands for a
  /// smooth surface it starts on that surface, so that neither the triangle's plane nor its
  /// neighbours shade it: the light's terminator then has no facets [Hanika, Ray Tracing Gems II,
  /// 2021]. The start stays where it is if something is between. False if the triangle itself is in
  /// the way. Thread safe.
  bool leave(const Surface& surface, const vec3& direction, bool front, RayStart& start) const;
  /// The same in two steps, for those who trace the ray between by themselves: if exit.asks(),
  /// occluded(exit.query(start)) has to be answered. `start` of leave() is settle()'s.
  static RayExit exit(const Surface& surface, const vec3& direction, bool front);

  dvec3 renderOrigin() const;
  Box3f bounds() const;  ///< render space, of meshes and media
  /// The scene's media; null if it has none.
  const Media* media() const;
  Statistics statistics() const;
  /// What the pages did so far; all zero without a paged mesh.
  hccm::PageCache::Statistics pageStatistics() const;
  /// Rays so far whose answer is of no use: they met a page that is not there and did not wait
  /// (hccm::PagedMesh::setWaiting()). Such a ray has hit nothing, or is blocked.
  std::uint64_t missed() const;
  const Parts& parts() const;

  /// What rays see from now on. Not to be called while rays are traced. bounds() stays that of all.
  void setVisibility(const Visibility& visibility);
  const Visibility& visibility() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace trex
