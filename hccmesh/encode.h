// From triangles of a source to the bytes of a cluster.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "hccmesh/hccmesh.h"
#include "hccmesh/split.h"
#include "hccmesh/strip.h"

namespace hccm {

/// The grid of a mesh.
struct Grid {
  glm::dvec3 origin{0.0};
  double cells = 1.0;  ///< 1 / step
  int stepExponent = 0;
};

/// A part with what its vertices need on the way to the grid.
struct Source {
  Part part;
  glm::dmat3 normalMatrix{1.0};  ///< inverse transpose
  bool mirrored = false;         ///< triangles are turned around
  std::uint8_t flags = 0;        ///< layout::Flags of its attributes, but those of floats

  glm::dvec3 transformed(std::uint32_t vertex) const {
    const glm::dvec3 p(part.positions[vertex]);
    const glm::dmat4& m = part.transform;
    return glm::dvec3(m[0]) * p.x + glm::dvec3(m[1]) * p.y + glm::dvec3(m[2]) * p.z +
           glm::dvec3(m[3]);
  }
  glm::ivec3 gridPosition(std::uint32_t vertex, const Grid& grid) const {
    const glm::dvec3 p = (transformed(vertex) - grid.origin) * grid.cells;
    return {static_cast<int>(std::floor(p.x + 0.5)), static_cast<int>(std::floor(p.y + 0.5)),
            static_cast<int>(std::floor(p.z + 0.5))};
  }
  /// The triangle's corners, counter-clockwise seen from the front.
  glm::uvec3 corners(std::uint32_t triangle) const {
    const glm::uvec3 t = part.triangles[triangle];
    return mirrored ? glm::uvec3(t.x, t.z, t.y) : t;
  }
};

/// A vertex as it is stored, or nearly so; vertices of equal bytes are one.
struct VertexKey {
  glm::ivec3 grid{0};
  std::uint32_t normal = 0;
  glm::vec2 texCoord{0.0f};
  glm::u8vec4 color{0};
  glm::vec2 secondTexCoord{0.0f};  ///< last: keys without it are told apart by what is before
};
static_assert(sizeof(VertexKey) == 36 && offsetof(VertexKey, secondTexCoord) == 28);

/// A cluster before it is bytes.
struct ClusterInput {
  const Source* source = nullptr;   ///< for material, object and flags
  std::vector<Strip> leaves;        ///< of vertex numbers
  std::vector<VertexKey> vertices;  ///< in the order of their first use by entries of leaves
};

/// Splits a piece into clusters and hands over each. The piece's triangles are of one material,
/// object and set of attributes.
void forEachCluster(std::span<const Source> sources, const Grid& grid,
                    std::span<const Reference> piece, const SplitLimits& limits,
                    const std::function<void(const ClusterInput&)>& take);

/// Splits a piece into clusters and appends their blobs; `sizes` takes the bytes of each.
void encodePiece(std::span<const Source> sources, const Grid& grid,
                 std::span<const Reference> piece, std::vector<std::byte>& blobs,
                 std::vector<std::uint32_t>& sizes);

}  // namespace hccm
