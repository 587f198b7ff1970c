// Building meshes that are larger than memory: triangles are read once and laid down on disk in
// cells of space, then cell by cell clustered in memory and packed into pages.
//
//   source ─ quantise ─ cell ──► spill file: chunks of triangles, by cell
//                                     │ neighbouring cells together, up to a bucket's size
//                                     ▼
//                                bucket: pieces by surface area ─ Mesh::build ─ packClusters ─►
//                                pages
//
// The order of cells is that of a k-d tree with its cuts in the middle, so pages follow each other
// in space. A cell that is too large for memory is spilled again into smaller ones, up to
// kMostSpills times; what is left after that, such as triangles that all have one centre, is cut by
// count.
//
// A spilled triangle takes 27 bytes (three corners of 3 x 24 bits on the mesh's grid), 12 more each
// with normals and colours, 24 with each set of texture coordinates, and 16 a run of one material
// and object.
//
// Equal sources and options give equal pages for any number of threads (oneTBB).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "hccmesh/pages.h"

namespace hccm {

/// A file could not be read or written; code() has the reason.
struct FileError : std::system_error {
  FileError(int reason, const std::string& what)
      : std::system_error(reason, std::generic_category(), what) {}
};

/// Triangles on their way, in mesh space; corner k of triangle i is at 3 * i + k. Attributes are
/// empty or as long as positions.
struct StreamBatch {
  struct Run {
    std::uint32_t material, object;
    std::uint64_t triangles;
  };
  glm::dvec3 origin{0.0};  ///< added to positions
  std::span<const glm::vec3> positions;
  std::span<const glm::vec3> normals;
  std::span<const glm::vec2> texCoords;
  std::span<const glm::u8vec4> colors;
  std::span<const glm::vec2> secondTexCoords;  ///< only with texCoords
  std::span<const Run> runs;                   ///< in order, all triangles in one
};

/// Where triangles come from. Calls come from several threads at a time.
class StreamSource {
 public:
  virtual ~StreamSource() = default;
  virtual std::uint64_t batchCount() const = 0;
  /// Calls use() once with a batch, whose arrays live until it returns.
  virtual void read(std::uint64_t number,
                    const std::function<void(const StreamBatch&)>& use) const = 0;
};

/// The integer grid of a mesh whose bounds are known before its triangles.
struct StreamGrid {
  int stepExponent = -24;
  glm::ivec3 lower{0}, upper{0};  ///< grid bounds that every vertex lies in

  /// For triangles inside a box around the origin, mesh space. Throws std::invalid_argument if it
  /// is not finite or beyond the limits.
  static StreamGrid make(const glm::dvec3& lower, const glm::dvec3& upper, int precisionBits);
};

/// A stretch of the spill file: the triangles of one cell, in the order of the source.
struct SpillChunk {
  std::uint64_t offset = 0, checksum = 0;  ///< XXH3-64
  std::uint32_t bytes = 0, triangles = 0;
};

struct SpillCell {
  std::uint64_t triangles = 0;
  glm::ivec3 lower{0}, upper{0};  ///< centres lie inside, grid
  std::vector<SpillChunk> chunks;
};

struct Spill {
  std::vector<SpillCell> cells;  ///< in spatial order; empty ones left out
  std::uint64_t given = 0;       ///< triangles of the source
  std::uint64_t kept = 0;        ///< of these
  std::uint64_t nonFinite = 0;   ///< dropped: a corner is not finite
  std::uint64_t flat = 0;        ///< dropped: two corners are one on the grid
  std::uint64_t fileBytes = 0;

  std::vector<std::byte> toBytes() const;
  /// Throws FormatError. Chunks lie inside fileBytes.
  static Spill fromBytes(std::span<const std::byte> bytes);
};

struct StreamOptions {
  StreamGrid grid;
  std::uint64_t memoryBytes = std::uint64_t{1} << 30;  ///< what a build may hold, at least 64 MiB
  /// Asked from time to time with what is done, [0, 1]; false ends in std::runtime_error.
  std::function<bool(double)> keepGoing = [](double) { return true; };

  std::uint64_t bucketTriangles() const;   ///< largest bucket
  std::uint32_t spillBufferBytes() const;  ///< a cell
};

/// Lays a source down in a new file. Throws FileError, std::invalid_argument for triangles outside
/// of the grid's bounds, and whatever the source throws.
Spill spillTriangles(const StreamSource& source, const StreamOptions& options,
                     const std::filesystem::path& file);

/// Cells [first, end) that are clustered together.
struct Bucket {
  std::size_t first, end;
};
std::vector<Bucket> planBuckets(const Spill& spill, const StreamOptions& options);

/// Takes pages, in order.
using PageSink = std::function<void(const BuiltPage&)>;

/// Turns buckets [from, end) into pages. `done` is called after the last page of each with its
/// number. Throws FileError; FormatError if a chunk's checksum is wrong; std::invalid_argument if
/// the spill file does not fit to the spill.
void buildPages(const std::filesystem::path& file, const Spill& spill,
                std::span<const Bucket> buckets, std::size_t from, const StreamOptions& options,
                const PageSink& sink, const std::function<void(std::size_t)>& done);

}  // namespace hccm
