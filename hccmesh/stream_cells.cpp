#include "hccmesh/stream_cells.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>

#include "hccmesh/layout.h"

namespace hccm {

CellGrid::CellGrid(const glm::ivec3& lower, const glm::ivec3& upper, int bits)
    : bits_(0), lower_(lower), size_(glm::dvec3(upper) - glm::dvec3(lower) + 1.0) {
  int cuts[3] = {};
  std::vector<int> axes;
  glm::dvec3 edge = size_;
  for (; bits_ < bits; ++bits_) {
    int axis = edge.x >= edge.y ? 0 : 1;
    if (edge.z > edge[axis]) axis = 2;
    if (edge[axis] <= 1.0) break;
    edge[axis] *= 0.5;
    ++cuts[axis];
    axes.push_back(axis);
  }
  for (int k = 0; k < 3; ++k) {
    const std::size_t places = std::size_t{1} << cuts[k];
    parts_[k].assign(places, 0);
    base_[k] = 3.0 * lower[k];
    scale_[k] = double(places) / (3.0 * size_[k]);
    for (std::size_t place = 0; place < places; ++place) {
      int bit = cuts[k];  // the first cut is the highest bit
      for (std::size_t i = 0; i < axes.size(); ++i)
        if (axes[i] == k && (place >> --bit & 1u)) parts_[k][place] |= 1u << (axes.size() - 1 - i);
    }
  }
}

void CellGrid::boundsOf(std::uint32_t cell, glm::ivec3& lower, glm::ivec3& upper) const {
  for (int k = 0; k < 3; ++k) {
    const std::uint32_t own = cell & parts_[k].back();  // the last place has all bits of the axis
    const auto found = std::find(parts_[k].begin(), parts_[k].end(), own);
    const double edge = size_[k] / double(parts_[k].size());
    const double place = double(found - parts_[k].begin());
    lower[k] = lower_[k] + static_cast<int>(std::floor(place * edge));
    upper[k] = lower_[k] + static_cast<int>(std::ceil((place + 1.0) * edge)) - 1;
  }
}

std::size_t spilledBytes(std::uint32_t flags) {
  return 3 * (kCornerBytes + ((flags & layout::kNormals) ? 4u : 0u) +
              ((flags & layout::kTexCoords) ? 8u : 0u) + ((flags & layout::kColors) ? 4u : 0u) +
              ((flags & layout::kSecondTexCoords) ? 8u : 0u));
}

CellWriter::CellWriter(StreamFile& file, std::uint64_t end, const CellGrid& grid,
                       std::uint32_t bufferBytes)
    : file_(file),
      end_(end),
      grid_(grid),
      bufferBytes_(bufferBytes),
      buffers_(grid.cells()),
      cells_(grid.cells()) {}

void CellWriter::add(std::uint32_t cell, std::span<const std::byte> bytes,
                     std::uint32_t triangles) {
  Buffer& b = buffers_[cell];
  if (b.bytes.capacity() == 0) b.bytes.reserve(std::max<std::size_t>(bufferBytes_, bytes.size()));
  // A chunk stays below the buffer, so that buffers do not grow.
  if (!b.bytes.empty() && b.bytes.size() + bytes.size() > bufferBytes_) flush(cell);
  b.bytes.insert(b.bytes.end(), bytes.begin(), bytes.end());
  b.triangles += triangles;
  if (b.bytes.size() >= bufferBytes_) {
    flush(cell);
    if (b.bytes.capacity() > 2 * std::size_t{bufferBytes_}) std::vector<std::byte>().swap(b.bytes);
  }
}

void CellWriter::flush(std::uint32_t cell) {
  Buffer& b = buffers_[cell];
  if (b.triangles == 0) return;
  file_.write(end_, b.bytes);
  cells_[cell].chunks.push_back({end_, XXH3_64bits(b.bytes.data(), b.bytes.size()),
                                 static_cast<std::uint32_t>(b.bytes.size()), b.triangles});
  cells_[cell].triangles += b.triangles;
  end_ += b.bytes.size();
  b.bytes.clear();
  b.triangles = 0;
}

std::vector<SpillCell> CellWriter::finish() {
  std::vector<SpillCell> out;
  for (std::uint32_t c = 0; c < cells_.size(); ++c) {
    flush(c);
    if (cells_[c].triangles == 0) continue;
    grid_.boundsOf(c, cells_[c].lower, cells_[c].upper);
    out.push_back(std::move(cells_[c]));
  }
  buffers_.clear();
  return out;
}

void readChunk(const StreamFile& file, const SpillChunk& chunk, std::vector<std::byte>& out) {
  out.resize(chunk.bytes);
  file.read(chunk.offset, out);
  if (XXH3_64bits(out.data(), out.size()) != chunk.checksum)
    throw FormatError("hccm: the spilled chunk at byte " + std::to_string(chunk.offset) +
                      " has a wrong checksum");
}

std::vector<SpillCell> spillAgain(StreamFile& file, const SpillCell& cell,
                                  std::uint32_t bufferBytes) {
  const CellGrid grid(cell.lower, cell.upper, kMostCellBits);
  CellWriter writer(file, file.size(), grid, bufferBytes);
  std::vector<std::byte> bytes, one;
  for (const SpillChunk& chunk : cell.chunks) {
    readChunk(file, chunk, bytes);
    forRuns(bytes, [&](RunHeader h, std::span<const std::byte> run) {
      const std::size_t stride = spilledBytes(h.flags), count = h.triangles;
      // Neighbours in the run mostly share a cell: they stay one run.
      for (std::size_t i = 0; i < count;) {
        const std::uint32_t to = grid.cellOf(getCorners(run.data() + i * stride));
        std::size_t end = i + 1;
        while (end < count && grid.cellOf(getCorners(run.data() + end * stride)) == to) ++end;
        h.triangles = static_cast<std::uint32_t>(end - i);
        one.resize(sizeof(h) + (end - i) * stride);
        std::memcpy(one.data(), &h, sizeof(h));
        std::memcpy(one.data() + sizeof(h), run.data() + i * stride, (end - i) * stride);
        writer.add(to, one, h.triangles);
        i = end;
      }
    });
  }
  return writer.finish();
}

}  // namespace hccm
