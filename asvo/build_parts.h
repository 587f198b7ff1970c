// What the parts of the builder share. Private to asvo/.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "asvo/asvo.h"
#include "asvo/polygon.h"
#include "asvo/tracer.h"
#include "asvo/triangle_box.h"

namespace asvo {

/// Bytes of a node with its voxel and light, and of a leaf.
inline constexpr std::uint64_t kBytesPerNode = sizeof(uvec2) + 2 * sizeof(uvec4);
inline constexpr std::uint64_t kBytesPerLeaf = kBytesPerNode + sizeof(uvec2);
/// Sub-voxels a leaf edge.
inline constexpr int kSubVoxels = 4;

/// The grid of sub-voxels over the cube.
struct Grid {
  glm::dvec3 lower;
  double size;
  int depth;
  double cells() const { return static_cast<double>(kSubVoxels << depth); }
  double scale() const { return cells() / size; }
  /// How far outside a box a triangle still counts as touching it, in sub-voxels: above the
  /// rounding of the tests here and of the tracer's positions, both a few ulp of the grid.
  double tolerance() const { return cells() * 1e-6; }
};

/// Morton code of a cell, x lowest; 10 bits an axis.
inline std::uint32_t mortonOf(const glm::uvec3& cell) {
  glm::uvec3 v = cell & 0x3ffu;
  v = (v | v << 16u) & 0x030000ffu;
  v = (v | v << 8u) & 0x0300f00fu;
  v = (v | v << 4u) & 0x030c30c3u;
  v = (v | v << 2u) & 0x09249249u;
  return v.x | v.y << 1 | v.z << 2;
}

/// Bounds of a triangle on the grid, wider than the tolerance of all tests.
void boundsOf(const Triangle& triangle, const Grid& grid, glm::vec3& lower, glm::vec3& upper);

/// A triangle on the grid with all that its leaves need.
struct GridTriangle {
  GridTriangle(const Triangle& triangle, const Grid& grid);
  Triangle source;
  glm::dvec3 vertex[3];    ///< sub-voxels
  glm::dvec3 normal;       ///< unit; zero if the triangle has no area
  glm::vec3 lower, upper;  ///< bounds, wider than any test's tolerance
  int flatAxis;            ///< axis along which it is thinner than the tolerance, or -1
  /// Empty if the bounds lie in one row of sub-voxels: then every cell that they touch is touched.
  std::optional<TriangleBox> box;
  std::optional<Shade> shade;  ///< if it is uniform and known
};

/// The shade of a triangle that has the same all over.
std::optional<Shade> uniformShade(const TriangleSource& source, const Triangle& triangle);

/// What filtering needs of a voxel beside its words.
struct Surface {
  vec2 sides{0.0f};  ///< area of faces along and against the normal, m^2
  float area() const { return sides.x > sides.y ? sides.x : sides.y; }
  float byDirection = 0.0f;  ///< of the faces' area, what sends light by its direction, m^2
  Moments moments;           ///< lengths in edges of the voxel from its centre, areas in m^2
};

/// What a voxel emits.
struct EmittedPower {
  std::uint32_t node;
  glm::vec3 side[2];  ///< radiance times area, W/sr; front, back
};

/// Leaves of a sub-tree in Morton order.
struct LeafList {
  std::vector<std::uint64_t> keys;
  std::vector<uvec4> voxels;
  std::vector<uvec2> leaves;
  std::vector<Surface> surfaces;
  std::vector<EmittedPower> emitters;  ///< node: number in the list
};

/// Makes leaves, one after the other, from the triangles that touch them. One a thread.
class LeafBuilder {
 public:
  LeafBuilder(const TriangleSource& source, const Grid& grid) : source_(source), grid_(grid) {}
  /// Starts the leaf with lower corner p, in sub-voxels.
  void start(const glm::vec3& p);
  /// Adds a triangle; `groups`: its tests that are not decided yet.
  void add(const GridTriangle& triangle, GroupMask groups);
  /// Appends the leaf to out, unless no sub-voxel was touched.
  void finish(std::uint64_t key, LeafList& out);

  /// The part of a triangle in the leaf, or of several.
  struct Piece {
    float weight;  ///< area in the leaf, in leaf faces, plus a trifle
    glm::vec3 normal;
    std::uint32_t material;
    Shade shade;
  };

 private:
  std::uint64_t touchedBy(const GridTriangle& triangle, GroupMask groups) const;
  void mergePieces();
  std::uint32_t dominantMaterial();
  std::uint32_t planeByte(const glm::vec3& normal) const;

  const TriangleSource& source_;
  const Grid& grid_;
  glm::vec3 corner_{0.0f};
  std::uint64_t mask_ = 0;
  bool merged_ = false;
  Moments moments_;  ///< of all pieces, in sub-voxels
  std::vector<Piece> pieces_;
  std::vector<glm::vec3> corners_;  ///< of all polygons, for the plane
  std::vector<std::pair<std::uint32_t, float>> materials_;
};

/// The cube around bounds: margins differ, so that walls on round coordinates seldom fall on faces
/// of voxels. Empty bounds: a unit cube.
Grid gridAround(const glm::dvec3& lower, const glm::dvec3& upper, int depth);

/// The leaves below the cell of a level with lower corner p (sub-voxels) and Morton code `key`,
/// from the triangles of a list, all of them buildable; in excess of maxLeaves it may stop. The
/// order of the list decides bits.
LeafList buildSubTree(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves,
                      int level, const glm::vec3& p, std::uint64_t key,
                      std::vector<std::uint32_t> list);

/// Whether the builder takes a triangle: finite, and no sliver.
bool isBuildable(const Triangle& triangle);

/// A depth, at most the grid's, such that none between the two can keep the limits (maxBytes: 0 for
/// none). It may not keep them itself.
int possibleDepth(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves,
                  std::uint64_t maxBytes);

/// The whole tree from lists of leaves in Morton order, of which none may be empty together.
Tree assemble(std::vector<LeafList>& lists, const Grid& grid);
/// A root without children.
Tree emptyTree(const Grid& grid);
/// Bytes of a tree's arrays with light.
std::uint64_t bytesOf(const Tree& tree);

/// Makes the levels above the leaves. tree.info, nodes (sized), voxels and surfaces of the leaves
/// and levelOffsets are set; keys are those of the leaves, `emitters` the leaves that emit.
void buildLevels(Tree& tree, std::vector<std::uint64_t> keys, std::vector<Surface>& surfaces,
                 std::vector<EmittedPower> emitters);

/// Average of normals. Faces that cancel each other, as those of a thin slab, are turned to one
/// side of their dominant axis first; the edges and corners of solid bodies are not.
class NormalSum {
 public:
  /// `along`, `against`: area of faces along and against the normal.
  void add(const glm::vec3& normal, float along, float against);
  /// Unit; of either sign.
  glm::vec3 normal() const;

 private:
  float total_ = 0.0f;
  glm::vec3 plain_{0.0f}, extent_{0.0f}, last_{0.0f, 0.0f, 1.0f};
  glm::vec3 aligned_[3] = {glm::vec3(0.0f), glm::vec3(0.0f), glm::vec3(0.0f)};
};

/// The voxel words of averages. `weight` is the sum of weights of albedo.
struct VoxelSums {
  float coverage[6] = {};  ///< +x -x +y -y +z -z, [0, 1]
  glm::vec3 albedo{0.0f};  ///< weighted
  float weight = 0.0f;
  glm::vec3 normal{0.0f, 0.0f, 1.0f};  ///< unit
  float area = 0.0f;                   ///< of a side, in faces of the voxel
  std::uint32_t material = 0;
  std::uint32_t plane = 0;   ///< its byte
  float byDirection = 0.0f;  ///< share of the faces
  /// `dither` in [0, 1): what is added before values are cut to their bits; 0.5 rounds.
  uvec4 pack(float dither) const;
};

/// A number in [0, 1) for a voxel by its Morton code. A rounding that is the same in all voxels
/// adds up along a path of photons or over levels: albedo 0.9 as 230/255 makes a closed room 2 %
/// too bright, a quarter of two units rounded up makes coarse levels denser. Dithered, means are
/// right.
float ditherOf(std::uint64_t key);

/// Levels that BuildOptions::deepen adds to a tree of that depth with so many leaves.
int levelsToDeepen(std::uint64_t leaves, int depth);
/// Area code of a voxel (asvo_layout.h); 0 for 0 alone.
std::uint32_t packArea(float faces, float dither);

/// Gives access to the packing functions of the tracer.
const Tracer& packer();

}  // namespace asvo
