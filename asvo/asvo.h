// ASVO: an augmented sparse voxel octree, the approximate scene that cones and photons are traced
// in. It answers in constant memory, whatever the size of the mesh [Kim, Sun, Yoon, TVCG 2014;
// Crassin et al. 2011; Laine and Karras 2010].
//
// Files of the library
//   asvo_layout.h   the arrays, word by word; shared with GLSL
//   asvo_trace.h    the tracer, one text for GLSL and C++; of that
//   asvo_voxel.h    what one voxel's words say
//   tracer.h        class Tracer: the C++ build of that text
//   medium.h        fog, smoke and fire beside the tree; medium_trace.h follows rays through them
//   FORMAT.md       the file
//
// What a tree holds
//
//   root, level 0          o                 a voxel a node, at every level: it is what a cone of
//                     .---' `---.            about the voxel's width sees
//   level 1           o         o
//                   .' `.      .'            voxel: coverage from six sides, albedo, normal,
//                   emission
//   ...            o     o    o                and area of each side, material, plane
//                                            leaf:  also a mask of 4x4x4 sub-voxels, and a plane
//   level depth   #  #   #   # #               that the mask cuts out
//
//   A place without geometry has no node. Bytes a voxel: 8 node, 16 voxel, 16 light (allocated by
//   who traces), and 8 a leaf; about 46 in all, or 60 a leaf with its share of the levels above. Of
//   a leaf's bytes 19 are geometry (mask 8, coverage 4.5, normal 3.25, plane 1, area 2; a quarter
//   is spare), 21 material and light. Emission stands apart, 12 bytes for each voxel that emits.
//
// Sides. The normal of a voxel points to its front. Front and back have emission and light of their
// own, and the same area: the larger of the areas of faces along and against the
// normal: a sheet receives light on both sides, a slab once on each. A child's front is part of its
// parent's back where their normals are opposed (asvoFlips); sums over sides that go up the tree
// follow that.
//
// Promises
//   Masks are conservative: every point of every triangle lies in an occupied sub-voxel, with a
//   tolerance above the rounding of the tracer, so a closed surface stops every narrow ray.
//   Areas are exact: those of the leaves sum to that of the mesh, within 3e-4 (of one-sided
//   leaves). No value is NaN, whatever the triangles. Triangles that are not finite or thinner than
//   a millionth of their longest edge are ignored. The same bits for any number of threads.
//
// Limits. Voxels above the leaves see flat surfaces exactly and the edges and corners of rooms only
// on average: about 0.7 % of cones inside a closed turned box get through. Narrow rays see
// scattered small triangles as blocks of sub-voxels, hence too dense. Radiance in light and
// emission has 9 bits and lies in [6e-8, 65408].
//
// Trust. build() takes any triangles; fromBytes() takes hostile bytes: it checks sizes before it
// allocates, checksums, and every index that a tracer follows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <stdexcept>
#include <vector>

#include "asvo/asvo_layout.h"

namespace asvo {

/// Thrown for bytes or arrays that are not a valid tree; the message says what and where.
struct FormatError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A triangle of a source, in render space (metres). Front: counter-clockwise.
struct Triangle {
  glm::vec3 position[3];
  std::uint32_t material = 0;  ///< below 65536 (larger ones are stored as 65535)
  std::uint32_t shadeKey = 0;  ///< passed back to shade()
};

/// What a surface point contributes to its voxel. Values that are not finite or negative become 0.
struct Shade {
  glm::vec3 albedo{0.0f};    ///< diffuse reflectance, linear, [0, 1]
  glm::vec3 emission{0.0f};  ///< emitted radiance, W/(m^2 sr), of the front side
  bool emitsBack = false;    ///< the back side emits the same
  bool byDirection = false;  ///< it sends light by its direction, which albedo does not tell
};

/// Where triangles come from. get() and shade() are called by several threads at a time and must
/// give the same answer each time.
class TriangleSource {
 public:
  virtual ~TriangleSource() = default;
  virtual std::uint64_t count() const = 0;
  /// Triangle i; vertices that are not finite make it ignored.
  virtual void get(std::uint64_t i, Triangle& triangle) const = 0;
  /// At weight u of the second and v of the third vertex.
  virtual Shade shade(const Triangle& triangle, float u, float v) const = 0;
  /// Whether shade() is the same all over the triangle, so that it need not be asked in each voxel.
  virtual bool uniform(const Triangle&) const { return false; }
};

struct BuildOptions {
  int depth = 0;                        ///< 1..ASVO_MAX_DEPTH; 0: 8, less if limits say so
  std::uint64_t maxLeaves = 1'300'000;  ///< depth is reduced until the leaves fit
  /// Depth is raised where nearly all of the cube is empty, until there are about as many leaves as
  /// in one whose faces are full: a room far from other things gets leaves for its own size.
  bool deepen = false;
  std::uint64_t maxBytes = 0;  ///< of the arrays of the tree with light; 0: no limit
  glm::vec3 lower{0.0f};       ///< corner of the cube, if size > 0
  float size = 0.0f;           ///< edge of the cube; 0: bounds of the triangles, grown a little
};

/// A voxel that emits: its node, and the radiance of front and back, W/(m^2 sr), rgb9e5.
struct Emitter {
  std::uint32_t node, front, back;
  bool operator==(const Emitter&) const = default;
};

/// The tree: plain arrays as asvo_layout.h describes them, ready to be copied to a device.
class Tree {
 public:
  AsvoInfo info{};
  std::vector<uvec2> nodes;
  std::vector<uvec4> voxels;                ///< one a node
  std::vector<uvec2> leaves;                ///< info.leafCount
  std::vector<Emitter> emitters;            ///< the nodes that emit, in order
  std::vector<std::uint32_t> levelOffsets;  ///< depth + 2: nodes of level l are [l], [l + 1)
  std::uint64_t sourceHash = 0;  ///< of what it was built from, kept in the file; caller's

  /// Builds from a source (rates: asvo_bench), in about twice the memory of the tree, 16 bytes a
  /// triangle and a few MB a thread. Uses the threads of the calling oneTBB arena; the result has
  /// the same bits for any number of them. Throws std::invalid_argument for options outside their
  /// ranges or more than 2^32 - 1 triangles.
  static Tree build(const TriangleSource& source, const BuildOptions& options = {});
  /// Takes a file's bytes after validating all of it. Throws FormatError.
  static Tree fromBytes(std::span<const std::byte> bytes);
  /// Emitted radiance of a side of a node's voxel.
  glm::vec3 emission(std::uint32_t node, bool front) const;
  /// Edge of a voxel of a level, metres.
  float edge(std::uint32_t level) const { return info.size / static_cast<float>(1u << level); }
  /// Triangle area of each side of a leaf, m^2.
  float leafArea(std::uint32_t node) const;
  /// The bytes of a file, see FORMAT.md.
  std::vector<std::byte> toBytes() const;
};

/// Checks every index and value that a tracer relies on. Throws FormatError.
void validate(const Tree& tree);

}  // namespace asvo
