// The first half of a streaming build: from a source to cells of triangles on disk.
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "hccmesh/layout.h"
#include "hccmesh/octahedral.h"
#include "hccmesh/stream_cells.h"

namespace hccm {
namespace {

/// A batch on the grid, in the order of cells.
struct Quantised {
  struct Segment {
    std::uint32_t cell, triangles;
    std::size_t offset, bytes;
  };
  std::vector<std::byte> bytes;
  std::vector<Segment> segments;
  std::uint64_t given = 0, nonFinite = 0, flat = 0;
};

/// Puts batches on the grid. One a call; thread safe.
class Quantiser {
 public:
  Quantiser(const StreamGrid& grid, const CellGrid& cells)
      : grid_(grid), cells_(cells), scale_(std::ldexp(1.0, -grid.stepExponent)) {}

  Quantised operator()(const StreamBatch& b) const {
    Quantised out;
    const std::size_t count = b.positions.size() / 3;
    out.given = count;
    std::vector<Corners9> corners(count);
    std::vector<std::uint32_t> cellOf(count);
    for (std::size_t i = 0; i < count; ++i) cellOf[i] = place(b, i, corners[i], out);
    sort(b, corners, cellOf, out);
    return out;
  }

 private:
  static constexpr std::uint32_t kDropped = 0xffffffffu;

  std::uint32_t place(const StreamBatch& b, std::size_t i, Corners9& c, Quantised& out) const {
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec3 p = (b.origin + glm::dvec3(b.positions[3 * i + k])) * scale_;
      if (!std::isfinite(p.x + p.y + p.z)) {
        ++out.nonFinite;
        return kDropped;
      }
      for (int axis = 0; axis < 3; ++axis) {
        const double g = std::floor(p[axis] + 0.5);
        if (!(g >= grid_.lower[axis] && g <= grid_.upper[axis]))
          throw std::invalid_argument("hccm: a triangle lies outside of the bounds stated");
        c[3 * k + static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(g);
      }
    }
    const auto same = [&](int x, int y) {
      return std::equal(c.begin() + 3 * x, c.begin() + 3 * x + 3, c.begin() + 3 * y);
    };
    if (same(0, 1) || same(1, 2) || same(2, 0)) {
      ++out.flat;
      return kDropped;
    }
    return cells_.cellOf(c);
  }

  /// By cell, in a cell by run and then in the order of the batch.
  void sort(const StreamBatch& b, const std::vector<Corners9>& corners,
            const std::vector<std::uint32_t>& cellOf, Quantised& out) const {
    std::vector<std::uint32_t> starts(cells_.cells() + 1, 0), order(corners.size());
    for (const std::uint32_t c : cellOf)
      if (c != kDropped) ++starts[c + 1];
    for (std::size_t c = 1; c < starts.size(); ++c) starts[c] += starts[c - 1];
    std::vector<std::uint32_t> runOf(corners.size());
    std::size_t at = 0;
    for (std::size_t r = 0; r < b.runs.size(); ++r)
      for (std::uint64_t i = 0; i < b.runs[r].triangles; ++i)
        runOf[at++] = static_cast<std::uint32_t>(r);
    std::vector<std::uint32_t> next(starts.begin(), starts.end() - 1);
    for (std::size_t i = 0; i < cellOf.size(); ++i)
      if (cellOf[i] != kDropped) order[next[cellOf[i]]++] = static_cast<std::uint32_t>(i);
    const std::uint32_t flags = flagsOf(b);
    const std::size_t stride = spilledBytes(flags);
    out.bytes.reserve(starts.back() * stride + (b.runs.size() + 64) * sizeof(RunHeader));
    for (std::uint32_t c = 0; c + 1 < starts.size(); ++c) {
      if (starts[c] == starts[c + 1]) continue;
      const std::size_t before = out.bytes.size();
      for (std::uint32_t i = starts[c]; i < starts[c + 1];) {
        std::uint32_t end = i + 1;
        while (end < starts[c + 1] && runOf[order[end]] == runOf[order[i]]) ++end;
        putRun(b, b.runs[runOf[order[i]]], flags, corners, std::span(order).subspan(i, end - i),
               out.bytes);
        i = end;
      }
      out.segments.push_back({c, starts[c + 1] - starts[c], before, out.bytes.size() - before});
    }
  }

  static std::uint32_t flagsOf(const StreamBatch& b) {
    std::uint32_t flags = 0;
    if (!b.normals.empty()) flags |= layout::kNormals;
    if (!b.texCoords.empty()) flags |= layout::kTexCoords;
    if (!b.colors.empty()) flags |= layout::kColors;
    if (!b.secondTexCoords.empty()) flags |= layout::kSecondTexCoords;
    return flags;
  }

  static void putRun(const StreamBatch& b, const StreamBatch::Run& run, std::uint32_t flags,
                     const std::vector<Corners9>& corners, std::span<const std::uint32_t> list,
                     std::vector<std::byte>& out) {
    const RunHeader h{run.material, run.object, static_cast<std::uint32_t>(list.size()), flags};
    std::size_t at = out.size();
    out.resize(at + sizeof(h) + list.size() * spilledBytes(flags));
    std::memcpy(out.data() + at, &h, sizeof(h));
    at += sizeof(h);
    const auto put = [&](const auto& value) {
      std::memcpy(out.data() + at, &value, sizeof(value));
      at += sizeof(value);
    };
    for (const std::uint32_t i : list) {
      putCorners(out.data() + at, corners[i]);
      at += 3 * kCornerBytes;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t corner = 3 * std::size_t{i} + k;
        if (flags & layout::kNormals) put(normalCode(b.normals[corner]));
        if (flags & layout::kTexCoords) put(b.texCoords[corner]);
        if (flags & layout::kColors) put(b.colors[corner]);
        if (flags & layout::kSecondTexCoords) put(b.secondTexCoords[corner]);
      }
    }
  }

  static std::uint32_t normalCode(const glm::vec3& n) {
    const float size = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
    return size > 0.0f && std::isfinite(size) ? encodeOctahedral(n)
                                              : encodeOctahedral({0.0f, 0.0f, 1.0f});
  }

  const StreamGrid& grid_;
  const CellGrid& cells_;
  double scale_;
};

void putWord(std::vector<std::byte>& out, std::uint64_t value) {
  const auto* bytes = reinterpret_cast<const std::byte*>(&value);
  out.insert(out.end(), bytes, bytes + sizeof(value));
}

}  // namespace

StreamGrid StreamGrid::make(const glm::dvec3& lower, const glm::dvec3& upper, int precisionBits) {
  if (precisionBits < 8 || precisionBits > 24)
    throw std::invalid_argument("hccm: precisionBits is not 8..24");
  const glm::dvec3 size = upper - lower, reach = glm::max(glm::abs(lower), glm::abs(upper));
  const double largest = std::max({size.x, size.y, size.z});
  const double furthest = std::max({reach.x, reach.y, reach.z});
  if (!(largest >= 0.0) || !(furthest <= 1e30))
    throw std::invalid_argument("hccm: the bounds are empty or over 1e30 metres");
  StreamGrid grid;
  // One cell is left free at the ends: coordinates are stored as 24 bits above -2^23.
  int exponent = furthest > 0.0 ? layout::kMinStepExponent : -24;
  while (std::ldexp(largest, -exponent) > std::ldexp(1.0, precisionBits) ||
         std::ldexp(furthest, -exponent) > double(layout::kMaxGrid - 2))
    ++exponent;
  grid.stepExponent = exponent;
  for (int k = 0; k < 3; ++k) {
    grid.lower[k] = static_cast<int>(std::floor(std::ldexp(lower[k], -exponent))) - 1;
    grid.upper[k] = static_cast<int>(std::ceil(std::ldexp(upper[k], -exponent))) + 1;
  }
  return grid;
}

std::uint64_t StreamOptions::bucketTriangles() const {
  // What a build holds of a triangle, and of how many buckets at a time.
  constexpr std::uint64_t kBytes = 130, kBuckets = 3, kMost = 2'000'000;
  return std::clamp<std::uint64_t>(memoryBytes / 4 * 3 / (kBytes * kBuckets), 16'384, kMost);
}

std::uint32_t StreamOptions::spillBufferBytes() const {
  const std::uint64_t cells = std::uint64_t{1} << kMostCellBits;
  return static_cast<std::uint32_t>(
      std::clamp<std::uint64_t>(memoryBytes / 3 / cells, 4096, 128 * 1024));
}

Spill spillTriangles(const StreamSource& source, const StreamOptions& options,
                     const std::filesystem::path& path) {
  StreamFile file(path, StreamFile::Mode::kCreate);
  const CellGrid cells(options.grid.lower, options.grid.upper, kMostCellBits);
  const Quantiser quantise(options.grid, cells);
  CellWriter writer(file, 0, cells, options.spillBufferBytes());
  Spill spill;
  const std::uint64_t count = source.batchCount();
  std::uint64_t next = 0, done = 0;
  const auto tokens = static_cast<std::size_t>(2 * tbb::this_task_arena::max_concurrency());
  tbb::parallel_pipeline(
      tokens,
      tbb::make_filter<void, std::uint64_t>(tbb::filter_mode::serial_in_order,
                                            [&](tbb::flow_control& control) {
                                              if (next == count) control.stop();
                                              return next == count ? next : next++;
                                            }) &
          tbb::make_filter<std::uint64_t, Quantised>(
              tbb::filter_mode::parallel,
              [&](std::uint64_t number) {
                Quantised out;
                source.read(number, [&](const StreamBatch& batch) { out = quantise(batch); });
                return out;
              }) &
          tbb::make_filter<Quantised, void>(
              tbb::filter_mode::serial_in_order, [&](const Quantised& q) {
                for (const Quantised::Segment& s : q.segments)
                  writer.add(s.cell, std::span(q.bytes).subspan(s.offset, s.bytes), s.triangles);
                spill.given += q.given;
                spill.nonFinite += q.nonFinite;
                spill.flat += q.flat;
                if (!options.keepGoing(double(++done) / double(count)))
                  throw std::runtime_error("interrupted");
              }));
  spill.cells = writer.finish();
  spill.kept = spill.given - spill.nonFinite - spill.flat;
  spill.fileBytes = writer.end();
  return spill;
}

std::vector<std::byte> Spill::toBytes() const {
  std::vector<std::byte> out;
  for (const std::uint64_t v :
       {given, kept, nonFinite, flat, fileBytes, std::uint64_t{cells.size()}})
    putWord(out, v);
  for (const SpillCell& c : cells) {
    putWord(out, c.triangles);
    for (int k = 0; k < 3; ++k)
      putWord(out, std::uint64_t(std::uint32_t(c.lower[k])) << 32 | std::uint32_t(c.upper[k]));
    putWord(out, c.chunks.size());
    for (const SpillChunk& chunk : c.chunks) {
      putWord(out, chunk.offset);
      putWord(out, chunk.checksum);
      putWord(out, std::uint64_t(chunk.bytes) << 32 | chunk.triangles);
    }
  }
  return out;
}

Spill Spill::fromBytes(std::span<const std::byte> bytes) {
  const auto take = [&]() {
    std::uint64_t value;
    if (bytes.size() < sizeof(value)) throw FormatError("hccm: the spill's list ends early");
    std::memcpy(&value, bytes.data(), sizeof(value));
    bytes = bytes.subspan(sizeof(value));
    return value;
  };
  Spill s;
  for (std::uint64_t* v : {&s.given, &s.kept, &s.nonFinite, &s.flat, &s.fileBytes}) *v = take();
  const std::uint64_t cells = take();
  for (std::uint64_t i = 0; i < cells; ++i) {
    SpillCell& c = s.cells.emplace_back();
    c.triangles = take();
    for (int k = 0; k < 3; ++k) {
      const std::uint64_t both = take();
      c.lower[k] = static_cast<std::int32_t>(both >> 32);
      c.upper[k] = static_cast<std::int32_t>(both & 0xffffffffu);
    }
    const std::uint64_t chunks = take();
    for (std::uint64_t k = 0; k < chunks; ++k) {
      SpillChunk& chunk = c.chunks.emplace_back();
      chunk.offset = take();
      chunk.checksum = take();
      const std::uint64_t both = take();
      chunk.bytes = static_cast<std::uint32_t>(both >> 32);
      chunk.triangles = static_cast<std::uint32_t>(both & 0xffffffffu);
      if (chunk.offset > s.fileBytes || chunk.bytes > s.fileBytes - chunk.offset)
        throw FormatError("hccm: a spilled chunk lies outside of its file");
    }
  }
  return s;
}

}  // namespace hccm
