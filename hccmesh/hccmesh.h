// HCCMesh: a triangle mesh and its bounding volume hierarchy in one compressed, randomly accessible
// buffer, after HCCMeshes [Kim et al., Eurographics 2010].
//
// PURPOSE. Trace meshes many times larger than what a plain triangle hierarchy lets fit in memory:
// 6 to 7 bytes a triangle with all of the hierarchy (positions only; octahedral normals add about
// 2.5). A caller with a hierarchy or a cache of its own puts it over clusterBounds() and calls
// intersect() for each cluster that a ray may meet.
//
// MEMORY LAYOUT (FORMAT.md has every byte).
//
//   header | cluster table | blob blob blob ... | 32 zero bytes
//                             |
//                             header 36 | boxes of leaves, 8 bits | leaves: strips of triangles |
//                             vertices, wx+wy+wz bits each | attributes, if any
//
// The top level (top_level.h) is not stored: a Mesh builds it when it is made.
//
// A cluster is up to 256 triangles of one material and object, in leaves of up to 8.
//
// UNITS. Positions live on one integer grid for the whole mesh: step() is a power of two and
// |grid| <= 2^23, so a grid coordinate is exact in a float. "Mesh space" is metres relative to
// gridOrigin(): step * grid. t is in units of the ray's direction, which need not be unit length.
//
// WATERTIGHT. A vertex relative to the ray is float(grid - cell) - rest, where cell + rest is the
// ray's origin/step: it depends on the vertex's global integers and the ray alone, so two clusters
// compute bit-equal coordinates for a vertex they share, and the test of [Woop et al., JCGT 2013]
// (exact signs by a fallback to double) lets nothing through their common edge, however far the
// origin is. (An origin beyond four extents is first moved along the ray, in double, to two extents
// from the grid's origin: the same for all clusters.) Boxes are widened by more than the rounding
// of both tests [Ize, JCGT 2013]. A hierarchy above must allow for the same: clusters' bounds are
// already two cells wider than the vertices.
//
// ERRORS. The grid's integers are exact. Single precision, 8 triangles at a time, only decides
// which triangles a ray goes through, and bounds how wrong its t can be; t, u and v of these are
// then computed in double from the integers: a large triangle is met where it is, however far its
// corners are. What is lost from there on is 2^-53 of the distance to the corners, over the cosine.
// So no ray needs a start that is moved off its surface, or an end short of its target: the
// triangle of origin is left out by its number, and what lies in one plane with the start or with
// the target, within `slack`, is not met (Ray).
//
// TRUST. fromBytes() and fromView() take anything: they check every size, offset, index and box and
// an XXH3 of the whole buffer, and throw FormatError. What they accept never makes another call
// read outside the buffer. build() checks indices and throws std::invalid_argument; it drops
// triangles with non-finite corners. Cluster and triangle numbers given to a Mesh must be in range
// (not checked).
//
// THREADS. A Mesh is immutable: all const calls may run at once. build(), fromBytes() and
// fromView() use oneTBB. A PreparedRay and a Hit belong to one thread.
//
// LIMITS. 64 GiB a buffer; extents from 1e-26 (below: coarser) to 1e30 m; 2^31-1 clusters.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "hccmesh/bytes.h"
#include "hccmesh/expanded.h"
#include "hccmesh/top_level.h"

namespace hccm {

/// Thrown for a buffer that is not a valid mesh; the message says what and at which byte.
struct FormatError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Triangles of one material and one object, as they come from a source. Not owned.
struct Part {
  std::span<const glm::vec3> positions;
  std::span<const glm::uvec3> triangles;
  std::span<const glm::vec3> normals;    ///< empty or one a position
  std::span<const glm::vec2> texCoords;  ///< empty or one a position
  std::span<const glm::u8vec4> colors;   ///< empty or one a position
  /// Empty or one a position; only with texCoords.
  std::span<const glm::vec2> secondTexCoords;
  glm::dmat4 transform{1.0};  ///< to the space that gridOrigin is given in; affine
  std::uint32_t material = 0, object = 0;
};

struct ClusterPage;

struct BuildOptions {
  int precisionBits = 24;    ///< grid cells along the largest extent: 2^bits, 8..24
  bool chooseOrigin = true;  ///< grid origin = centre of the bounds; else as given
  glm::dvec3 gridOrigin{0.0};
  std::optional<int> stepExponent;  ///< step 2^n instead of one by precisionBits
};

/// Bytes by part, for `trex info` and the memory bar; texCoords: of both sets.
struct Sizes {
  std::uint64_t header = 0, clusterTable = 0, clusterHeaders = 0, vertices = 0, topology = 0,
                nodes = 0, normals = 0, texCoords = 0, colors = 0, padding = 0;
  std::uint64_t total() const;
  Sizes& operator+=(const Sizes& other);
};

/// u, v: barycentric weights of the second and third vertex, never outside the triangle. Starts as
/// "nothing".
struct Hit {
  static constexpr std::uint32_t kNothing = 0xffffffffu;
  double u = 0.0, v = 0.0;
  float t = 0.0f;
  std::uint32_t cluster = kNothing, triangle = kNothing;
};

/// A ray in mesh space. The largest component of the direction must be at least 2^-60 and finite,
/// else nothing is hit. tnear <= t <= tfar; tfar may be infinite.
struct Ray {
  glm::dvec3 origin;
  float tnear;
  glm::vec3 direction;
  float tfar;
  /// The triangle that the ray leaves, if it is one of this mesh; it is not met.
  std::uint32_t fromCluster = Hit::kNothing, fromTriangle = Hit::kNothing;
  /// Likewise the one that it ends on.
  std::uint32_t toCluster = Hit::kNothing, toTriangle = Hit::kNothing;
  /// Mesh units; how far the origin may be off a surface that it is meant to be on. A triangle
  /// whose plane is that close to the origin is not met. Negative: the origin is on no surface.
  double slack = -1.0;
  /// Where the ray ends, if on a surface; within `targetSlack` triangles in one plane with it are
  /// not met.
  std::optional<glm::dvec3> target = std::nullopt;
  double targetSlack = 0.0;
};

/// A decoded triangle in mesh space. Attributes that the mesh does not store are zero (colour one).
struct Triangle {
  glm::vec3 position[3];  ///< exact: step * grid
  glm::vec3 normal[3];
  glm::vec2 texCoord[3], secondTexCoord[3];
  glm::vec4 color[3];
  bool hasNormals, hasTexCoords, hasSecondTexCoords, hasColors;
  std::uint32_t material, object;
};

/// What a material is to a ray that asks whether anything blocks it.
enum class Passage : std::uint8_t {
  kBlocks,
  kPasses,  ///< does not block, but that it was met is told
  kAbsent,
};
struct Passages {
  const Passage* ofMaterial;  ///< by number, for all of the mesh
  bool met = false;           ///< set where something that passes lies on the way; not all are told
};

/// What one ray needs in every cluster, computed once a ray and mesh. Lengths in grid cells.
struct alignas(16) PreparedRay {
  std::int32_t cell[4];        ///< the origin, rounded
  float origin[4];             ///< and what is left of it
  float inverse[4];            ///< 1/direction, never infinite
  float shear[3];              ///< [Woop et al. 2013]: d[kx]/d[kz], d[ky]/d[kz], 1/d[kz]
  float tnear, tfar;           ///< in cells a unit of direction; see Mesh::setFar
  float sureFrom, sureTo;      ///< what lies between is met whatever its plane
  float step, cells;           ///< metres a cell, cells a metre
  float depth;                 ///< the direction's largest component, without sign
  std::int32_t axis[3];        ///< kx, ky, kz
  bool isFar;                  ///< `cell` is beyond what a float has exactly
  std::uint32_t nearPlane[4];  ///< of lower x, upper x, lower y, ...: which the ray meets first
  double shift;                ///< t that origin was moved forward by, in those units
  glm::dvec3 exactOrigin, direction, target;
  double slack, targetSlack;  ///< negative: no surface there
  std::uint32_t fromCluster, fromTriangle, toCluster, toTriangle;
  /// By object number, not 0: its clusters are not there for this ray. Null: all are.
  const std::uint8_t* hidden = nullptr;
  /// For occluded() alone; null: everything blocks. Not owned.
  Passages* passages = nullptr;
};

struct MeshView;
struct Kernels;
struct ExpandedKernels;

class Mesh {
 public:
  /// Builds from parts. Equal input gives equal bytes for any number of threads. Triangles with two
  /// equal corners on the grid are dropped (all others are kept, so nothing opens), as are those
  /// with non-finite corners; see droppedTriangles(). Parts of the same material, object and set of
  /// attributes share clusters. A part whose transform mirrors has its triangles turned around, so
  /// that counter-clockwise stays the front; normals go by the inverse transpose. Throws
  /// std::invalid_argument for an index out of range, an array of the wrong length or an extent
  /// outside the limits.
  static Mesh build(std::span<const Part> parts, const BuildOptions& options = {});
  /// Copies a buffer after validating all of it. Throws FormatError.
  static Mesh fromBytes(const std::vector<std::byte>& bytes);
  /// As above, of bytes that stay where they are, such as a mapped file: `owner` keeps them alive.
  /// They must start at a multiple of 8 and not change. Throws FormatError.
  static Mesh fromView(std::span<const std::byte> bytes, std::shared_ptr<const void> owner);
  /// A mesh of the blobs of a page as unpackClusters() gives them, on the grid of `grid`. Bounds
  /// and triangle count are not known to it, and it has no hierarchy over its clusters.
  static Mesh fromPage(const ClusterPage& page, const Mesh& grid);
  /// Likewise, of the bytes() of a mesh that fromPage() made, which are not looked at: unchanged,
  /// and as aligned as new. `owner` keeps them alive.
  static Mesh fromPageAgain(std::span<const std::byte> bytes, std::shared_ptr<const void> owner,
                            const Mesh& grid);
  /// How many bytes these are, of a page of so many clusters and bytes of blobs and tail.
  static std::size_t pageBytes(std::size_t clusters, std::size_t blobs);

  std::span<const std::byte> bytes() const { return bytes_; }
  /// Of all hierarchies over clusters; not in bytes().
  std::uint64_t topLevelBytes() const {
    return top_.bytes() + (expanded_ ? expanded_->bytes() : 0);
  }
  /// Makes rays about twice as fast, with the same bits, for about 360 bytes a leaf more: 45 to 50
  /// a triangle where leaves are full. Not while rays are traced.
  void expand();
  std::uint64_t triangleCount() const;
  std::uint64_t droppedTriangles() const;  ///< of the source
  std::uint32_t clusterCount() const;
  glm::dvec3 gridOrigin() const;  ///< metres
  double step() const;            ///< metres
  double errorBound() const;      ///< metres, largest distance of a vertex to its source
  Sizes sizes() const;            ///< walks over all clusters
  /// Conservative float bounds of a cluster in mesh space, two cells wider than its vertices.
  void clusterBounds(std::uint32_t cluster, glm::vec3& lower, glm::vec3& upper) const;
  /// Exact bounds of all vertices in mesh space; both zero if there is no triangle.
  void bounds(glm::vec3& lower, glm::vec3& upper) const;
  std::uint32_t clusterTriangleCount(std::uint32_t cluster) const;
  std::uint32_t clusterLeafCount(std::uint32_t cluster) const;
  std::uint32_t leafTriangleCount(std::uint32_t cluster, std::uint32_t leaf) const;
  std::uint32_t clusterMaterial(std::uint32_t cluster) const;
  std::uint32_t clusterObject(std::uint32_t cluster) const;
  /// `index` as in a Hit: 8 times the leaf, plus the place in the leaf. (So indices have gaps.)
  Triangle triangle(std::uint32_t cluster, std::uint32_t index) const;
  /// Calls use(index) for each triangle of a cluster, in order.
  template <typename Function>
  void forTriangles(std::uint32_t cluster, const Function& use) const {
    for (std::uint32_t leaf = 0; leaf < clusterLeafCount(cluster); ++leaf)
      for (std::uint32_t i = 0; i < leafTriangleCount(cluster, leaf); ++i) use(8 * leaf + i);
  }
  /// The blob of a cluster.
  std::span<const std::byte> clusterBytes(std::uint32_t cluster) const;

  PreparedRay prepare(const Ray& ray) const;
  /// Sets the far end of a prepared ray, in units of its direction.
  static void setFar(PreparedRay& ray, float tfar) {
    ray.tfar = static_cast<float>(double(tfar) * double(ray.cells) - ray.shift);
  }
  /// Nearest hit of the whole mesh, as below.
  bool intersect(PreparedRay& ray, Hit& hit) const;
  /// Whether anything of the whole mesh lies in [tnear, tfar].
  bool occluded(const PreparedRay& ray) const;
  /// As the two above for each ray of a span, with the same bits but faster: rays that are under
  /// way together wait for memory at the same time. `hits`, `blocked` (1 or 0): one a ray; a hit
  /// stays as it was where nothing nearer is found.
  void intersect(std::span<PreparedRay> rays, std::span<Hit> hits) const;
  void occluded(std::span<const PreparedRay> rays, std::span<std::uint8_t> blocked) const;
  /// Nearest hit inside one cluster in [tnear, tfar]; updates hit and tfar if it finds one. On
  /// equal t the lower (cluster, triangle) wins, so the result does not depend on the order of
  /// visits.
  bool intersect(std::uint32_t cluster, PreparedRay& ray, Hit& hit) const;
  bool occluded(std::uint32_t cluster, const PreparedRay& ray) const;
  /// The instruction set that this mesh's tests run on, "AVX2" for one.
  const char* targetName() const;

 private:
  static constexpr unsigned kBlobShift = 4;  ///< layout::kTableShift

  explicit Mesh(Bytes bytes);
  Mesh(std::span<const std::byte> bytes, std::shared_ptr<const void> owner);
  Mesh(std::span<const std::byte> bytes, std::shared_ptr<const void> owner, const Mesh& grid);
  const std::byte* blob(std::uint32_t cluster) const {
    return bytes_.data() + (std::size_t(table_[cluster]) << kBlobShift);
  }

  std::span<const std::byte> bytes_;
  std::shared_ptr<const void> owner_;     ///< of bytes_
  const std::uint32_t* table_ = nullptr;  ///< inside bytes_
  float step_ = 1.0f, cells_ = 1.0f;      ///< metres a cell, cells a metre
  MeshView view() const;

  TopLevel top_;
  std::shared_ptr<const Expanded> expanded_;  ///< null: rays meet clusters
  const Kernels* kernels_ = nullptr;          ///< for this processor, chosen when the mesh is made
  const ExpandedKernels* expandedKernels_ = nullptr;

 public:
  ~Mesh() = default;
  Mesh(Mesh&&) = default;
  Mesh& operator=(Mesh&&) = default;
  Mesh(const Mesh&) = delete;
  Mesh& operator=(const Mesh&) = delete;
};

}  // namespace hccm
