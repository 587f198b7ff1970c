// Cells of space, and triangles as they are spilled. Private to the streaming build.
#pragma once

#include <array>
#include <cstring>

#include "hccmesh/stream.h"
#include "hccmesh/stream_file.h"

namespace hccm {

inline constexpr int kMostSpills = 6;     ///< of one triangle
inline constexpr int kMostCellBits = 12;  ///< cells of one spill: 2^12
inline constexpr std::int32_t kBias = 1 << 23;
inline constexpr std::size_t kCornerBytes = 9;

using Corners9 = std::array<std::int32_t, 9>;  ///< x y z of three corners, grid

/// A box cut in the middle of its longest axis, again and again.
class CellGrid {
 public:
  /// Grid bounds, both inside; 0..kMostCellBits cuts.
  CellGrid(const glm::ivec3& lower, const glm::ivec3& upper, int bits);
  int bits() const { return bits_; }
  std::size_t cells() const { return std::size_t{1} << bits_; }
  /// The cell of a triangle's centre: a number that grows along the tree.
  std::uint32_t cellOf(const Corners9& c) const {
    std::uint32_t cell = 0;
    for (int k = 0; k < 3; ++k) {
      const double sum = double(c[k]) + double(c[k + 3]) + double(c[k + 6]);
      const double place = (sum - base_[k]) * scale_[k];
      const auto last = static_cast<double>(parts_[k].size() - 1);
      cell |= parts_[k][static_cast<std::size_t>(std::min(std::max(place, 0.0), last))];
    }
    return cell;
  }
  /// Grid bounds of a cell, a unit wider at most.
  void boundsOf(std::uint32_t cell, glm::ivec3& lower, glm::ivec3& upper) const;

 private:
  int bits_;
  glm::ivec3 lower_;
  glm::dvec3 size_, base_, scale_;
  std::array<std::vector<std::uint32_t>, 3> parts_;  ///< bits of the number by place on an axis
};

/// Leads a stretch of triangles of one kind.
struct RunHeader {
  std::uint32_t material = 0, object = 0, triangles = 0, flags = 0;
};
static_assert(sizeof(RunHeader) == 16);

/// Bytes of a spilled triangle.
std::size_t spilledBytes(std::uint32_t flags);

inline void putCorners(std::byte* out, const Corners9& c) {
  for (int i = 0; i < 9; ++i) {
    const auto word = static_cast<std::uint32_t>(c[i] + kBias);
    std::memcpy(out + 3 * i, &word, 3);
  }
}
inline Corners9 getCorners(const std::byte* in) {
  Corners9 c;
  for (int i = 0; i < 9; ++i) {
    std::uint32_t word = 0;
    std::memcpy(&word, in + 3 * i, 3);
    c[i] = static_cast<std::int32_t>(word) - kBias;
  }
  return c;
}

/// Buffers of cells in front of a file; full ones become chunks.
class CellWriter {
 public:
  CellWriter(StreamFile& file, std::uint64_t end, const CellGrid& grid, std::uint32_t bufferBytes);
  /// Appends runs to a cell.
  void add(std::uint32_t cell, std::span<const std::byte> bytes, std::uint32_t triangles);
  /// Writes what is left. Empty cells are left out.
  std::vector<SpillCell> finish();
  std::uint64_t end() const { return end_; }

 private:
  void flush(std::uint32_t cell);
  struct Buffer {
    std::vector<std::byte> bytes;
    std::uint32_t triangles = 0;
  };
  StreamFile& file_;
  std::uint64_t end_;
  const CellGrid& grid_;
  std::uint32_t bufferBytes_;
  std::vector<Buffer> buffers_;
  std::vector<SpillCell> cells_;
};

/// Reads a chunk and checks it. Throws FormatError, FileError.
void readChunk(const StreamFile& file, const SpillChunk& chunk, std::vector<std::byte>& out);

/// Calls run(header, bytes of its triangles) for each run of a chunk. Throws FormatError.
template <typename Function>
void forRuns(std::span<const std::byte> chunk, const Function& run) {
  while (!chunk.empty()) {
    RunHeader h;
    if (chunk.size() < sizeof(h)) throw FormatError("hccm: a spilled chunk ends in a header");
    std::memcpy(&h, chunk.data(), sizeof(h));
    const std::uint64_t bytes = std::uint64_t{h.triangles} * spilledBytes(h.flags);
    if (bytes > chunk.size() - sizeof(h)) throw FormatError("hccm: a spilled chunk ends in a run");
    run(h, chunk.subspan(sizeof(h), bytes));
    chunk = chunk.subspan(sizeof(h) + bytes);
  }
}

/// Spills a cell again into smaller ones.
std::vector<SpillCell> spillAgain(StreamFile& file, const SpillCell& cell,
                                  std::uint32_t bufferBytes);

/// How a mesh is cut into pages, by its size.
struct PageShape {
  std::size_t pageTriangles;    ///< at most, of one build
  std::uint32_t groupClusters;  ///< at most
  static PageShape forTriangles(std::uint64_t triangles);
};

/// Clusters and packs the triangles of some chunks.
std::vector<BuiltPage> clusterChunks(const StreamFile& file, std::span<const SpillChunk> chunks,
                                     int stepExponent, const PageShape& shape);

}  // namespace hccm
