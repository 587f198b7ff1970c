// A medium: fog, smoke or fire on a sparse grid of voxels, the part of the ASVO that fills space
// where the tree of voxels holds surfaces.
//
// Density is given at the centres of voxels and is trilinear between them. The eight centres
// around a place span a cell; bricks are 8x8x8 cells, so they hold 9x9x9 values and a look-up never
// leaves its brick. Values are 16 bits, in units of the brick's largest one, so thin wisps keep
// their shape beside dense smoke. A brick of one value holds no array; one of zeros does not exist.
// Emission, if there is any, is one rgb9e5 word a value.
//
//   grid    index ─► brick 0    largest, array ─► 729 x unorm16 (and 729 x rgb9e5)
//                    none
//                    brick 1    largest, no array (one value)
//
// Cell space: cell (x, y, z) lies between values (x, y, z) and (x + 1, y + 1, z + 1), value
// (0, 0, 0) belongs to voxel `base` of the source. medium_trace.h follows rays there; it is C++
// alone: cones whose axis meets a medium are traced by the host, so no shader knows of media.
//
// Trust. build() takes any values; fromBytes() takes hostile bytes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace asvo {

/// A brick of a source: 8x8x8 voxels from a corner that is a multiple of 8 in each axis.
struct MediumLeaf {
  glm::ivec3 origin{0};
  float density = 0.0f;                  ///< of all voxels, if `values` is empty
  std::span<const float> values;         ///< empty or 512 densities, x * 64 + y * 8 + z
  std::span<const glm::vec3> emissions;  ///< empty or 512, in the same order
};

/// Immutable once made; any number of threads may read it.
class Medium {
 public:
  static constexpr int kCells = 8;            ///< along a brick
  static constexpr int kValues = kCells + 1;  ///< along a brick
  static constexpr std::uint32_t kBrickValues = kValues * kValues * kValues;
  static constexpr std::uint32_t kNone = 0xffffffffu;
  /// Larger values are cut, so that products with lengths stay in single precision.
  static constexpr float kMostDensity = 1e12f;
  /// Entries of the index: a grid that is spread wider is refused.
  static constexpr std::uint64_t kMostIndex = std::uint64_t{1} << 26;

  struct Brick {
    float largest = 0.0f;          ///< of its densities
    std::uint32_t values = kNone;  ///< its array is number `values`; none: all are `largest`
    std::uint32_t emission = 0;    ///< the largest emission by channel, rgb9e5; 0: none
  };

  /// An upper bound of the bytes that build() makes of leaves whose corners lie in [lower, upper].
  static std::uint64_t bytesNeeded(const glm::ivec3& lower, const glm::ivec3& upper,
                                   std::uint64_t leaves, std::uint64_t uniformLeaves,
                                   bool emission);
  /// Builds from leaves, each place at most once. What is not finite or negative becomes 0 and what
  /// is larger than kMostDensity is cut; both are counted. Throws FormatError if the index would
  /// have more than kMostIndex entries.
  static Medium build(std::span<const MediumLeaf> leaves);
  /// The bytes of a file, FORMAT.md; equal media give equal bytes.
  std::vector<std::byte> toBytes() const;
  /// Takes hostile bytes: sizes, indices and values are checked. Throws FormatError.
  static Medium fromBytes(std::span<const std::byte> bytes);

  glm::ivec3 base{0};                    ///< voxel of value (0, 0, 0), a multiple of 8
  glm::ivec3 size{0};                    ///< bricks along each axis; 0: an empty medium
  float emissionScale = 1.0f;            ///< stored emission times this is the source's
  std::vector<std::uint32_t> index;      ///< x + size.x * (y + size.y * z): brick, or kNone
  std::vector<Brick> bricks;             ///< none is all zeros
  std::vector<std::uint16_t> densities;  ///< kBrickValues an array; x * 81 + y * 9 + z
  std::vector<std::uint32_t> emissions;  ///< as long as densities, or empty
  std::uint64_t dropped = 0;             ///< values that were not finite or negative (build() only)
  std::uint64_t cut = 0;                 ///< values that were too large (build() only)
  std::uint64_t voxels = 0;              ///< of the source with a density or an emission

  bool empty() const { return bricks.empty(); }
  bool emits() const { return !emissions.empty(); }
  /// Of all arrays.
  std::uint64_t bytes() const;
};

}  // namespace asvo
