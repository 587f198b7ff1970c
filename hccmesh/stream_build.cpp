// The second half of a streaming build: from cells on disk to pages.
#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <numeric>
#include <tuple>

#include "hccmesh/layout.h"
#include "hccmesh/octahedral.h"
#include "hccmesh/split.h"
#include "hccmesh/stream_cells.h"

namespace hccm {
namespace {

constexpr std::size_t kPageBlobBytes = std::size_t{1} << 19;  ///< where a page is cut

using GroupKey = std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>;

/// Triangles of a bucket in memory.
struct Soup {
  std::vector<Corners9> corners;
  std::vector<std::uint32_t> kind;  ///< into kinds
  std::vector<GroupKey> kinds;      ///< material, object, flags
  // By 3 * triangle + corner; empty if no run has them.
  std::vector<std::uint32_t> normals;
  std::vector<glm::vec2> texCoords, secondTexCoords;
  std::vector<glm::u8vec4> colors;

  void add(const RunHeader& h, std::span<const std::byte> run);

 private:
  std::map<GroupKey, std::uint32_t> numbers_;
};

void Soup::add(const RunHeader& h, std::span<const std::byte> run) {
  const GroupKey key(h.material, h.object, h.flags);
  const auto [found, isNew] = numbers_.emplace(key, static_cast<std::uint32_t>(kinds.size()));
  if (isNew) kinds.push_back(key);
  const std::size_t first = corners.size(), end = first + h.triangles;
  corners.resize(end);
  kind.resize(end, found->second);
  const auto grow = [&](auto& array, std::uint32_t flag) {
    if ((h.flags & flag) || !array.empty()) array.resize(3 * end);
  };
  grow(normals, layout::kNormals);
  grow(texCoords, layout::kTexCoords);
  grow(colors, layout::kColors);
  grow(secondTexCoords, layout::kSecondTexCoords);
  const std::byte* at = run.data();
  const auto get = [&](auto& value) {
    std::memcpy(static_cast<void*>(&value), at, sizeof(value));
    at += sizeof(value);
  };
  for (std::size_t i = first; i < end; ++i) {
    corners[i] = getCorners(at);
    at += 3 * kCornerBytes;
    for (std::size_t k = 0; k < 3; ++k) {
      if (h.flags & layout::kNormals) get(normals[3 * i + k]);
      if (h.flags & layout::kTexCoords) get(texCoords[3 * i + k]);
      if (h.flags & layout::kColors) get(colors[3 * i + k]);
      if (h.flags & layout::kSecondTexCoords) get(secondTexCoords[3 * i + k]);
    }
  }
}

std::vector<Reference> referencesOf(const Soup& soup) {
  std::vector<Reference> out(soup.corners.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Corners9& c = soup.corners[i];
    for (std::size_t k = 0; k < 3; ++k) {
      out[i].lower[k] = static_cast<float>(std::min({c[k], c[k + 3], c[k + 6]}));
      out[i].upper[k] = static_cast<float>(std::max({c[k], c[k + 3], c[k + 6]}));
    }
    out[i].source = soup.kind[i];
    out[i].triangle = static_cast<std::uint32_t>(i);
  }
  return out;
}

/// The arrays of one page's parts.
class PageParts {
 public:
  PageParts(const Soup& soup, std::span<const Reference> references, float step) {
    std::vector<Reference> order(references.begin(), references.end());
    std::sort(order.begin(), order.end(), [](const Reference& a, const Reference& b) {
      return std::tie(a.source, a.triangle) < std::tie(b.source, b.triangle);
    });
    const std::size_t n = order.size();
    positions_.reserve(3 * n);
    triangles_.resize(n);
    for (std::uint32_t i = 0; i < n; ++i) triangles_[i] = {3 * i, 3 * i + 1, 3 * i + 2};
    if (!soup.normals.empty()) normals_.reserve(3 * n);
    if (!soup.texCoords.empty()) texCoords_.reserve(3 * n);
    if (!soup.colors.empty()) colors_.reserve(3 * n);
    if (!soup.secondTexCoords.empty()) secondTexCoords_.reserve(3 * n);
    for (const Reference& r : order) {
      const Corners9& c = soup.corners[r.triangle];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t corner = 3 * std::size_t{r.triangle} + k;
        positions_.push_back(glm::vec3(c[3 * k], c[3 * k + 1], c[3 * k + 2]) * step);
        if (!soup.normals.empty()) normals_.push_back(decodeOctahedral(soup.normals[corner]));
        if (!soup.texCoords.empty()) texCoords_.push_back(soup.texCoords[corner]);
        if (!soup.colors.empty()) colors_.push_back(soup.colors[corner]);
        if (!soup.secondTexCoords.empty()) secondTexCoords_.push_back(soup.secondTexCoords[corner]);
      }
    }
    for (std::size_t i = 0; i < n;) {
      std::size_t end = i + 1;
      while (end < n && order[end].source == order[i].source) ++end;
      parts.push_back(part(soup.kinds[order[i].source], i, end - i));
      i = end;
    }
  }
  std::vector<Part> parts;

 private:
  Part part(const GroupKey& kind, std::size_t first, std::size_t count) const {
    const auto [material, object, flags] = kind;
    const auto take = [&](const auto& array) {
      return std::span(array).subspan(3 * first, 3 * count);
    };
    Part p;
    p.positions = take(positions_);
    p.triangles = std::span(triangles_).first(count);
    if (flags & layout::kNormals) p.normals = take(normals_);
    if (flags & layout::kTexCoords) p.texCoords = take(texCoords_);
    if (flags & layout::kColors) p.colors = take(colors_);
    if (flags & layout::kSecondTexCoords) p.secondTexCoords = take(secondTexCoords_);
    p.material = material;
    p.object = object;
    return p;
  }

  std::vector<glm::vec3> positions_, normals_;
  std::vector<glm::vec2> texCoords_, secondTexCoords_;
  std::vector<glm::u8vec4> colors_;
  std::vector<glm::uvec3> triangles_;
};

float areaOf(const float* lower, const float* upper) {
  const float x = upper[0] - lower[0], y = upper[1] - lower[1], z = upper[2] - lower[2];
  return x * y + y * z + z * x;
}

/// Neighbours join a group as long as its box is hardly larger than theirs together.
std::vector<PageGroup> groupsOf(const Mesh& mesh, std::uint32_t first, std::uint32_t end,
                                std::uint32_t most) {
  constexpr float kLoose = 1.5f;
  std::vector<PageGroup> out;
  float areas = 0.0f;
  for (std::uint32_t c = first; c < end; ++c) {
    glm::vec3 lower, upper;
    mesh.clusterBounds(c, lower, upper);
    const float own = areaOf(&lower[0], &upper[0]);
    if (!out.empty() && out.back().count < most) {
      PageGroup joined = out.back();
      for (int k = 0; k < 3; ++k) {
        joined.lower[k] = std::min(joined.lower[k], lower[k]);
        joined.upper[k] = std::max(joined.upper[k], upper[k]);
      }
      if (areaOf(joined.lower, joined.upper) <= kLoose * (areas + own)) {
        ++joined.count;
        out.back() = joined;
        areas += own;
        continue;
      }
    }
    PageGroup& g = out.emplace_back();
    std::copy_n(&lower[0], 3, g.lower);
    std::copy_n(&upper[0], 3, g.upper);
    g.first = static_cast<std::uint16_t>(c - first);
    g.count = 1;
    areas = own;
  }
  return out;
}

BuiltPage packPage(const Mesh& mesh, std::uint32_t first, std::uint32_t end,
                   std::uint32_t groupClusters) {
  std::vector<std::span<const std::byte>> blobs;
  BuiltPage page;
  for (std::uint32_t c = first; c < end; ++c) {
    blobs.push_back(mesh.clusterBytes(c));
    page.entry.triangles += mesh.clusterTriangleCount(c);
  }
  page.packed = packClusters(blobs);
  page.entry.packedBytes = static_cast<std::uint32_t>(page.packed.size());
  page.entry.checksum = XXH3_64bits(page.packed.data(), page.packed.size());
  page.entry.bytes = static_cast<std::uint32_t>(unpackedBytes(page.packed));
  page.entry.clusters = end - first;
  page.groups = groupsOf(mesh, first, end, groupClusters);
  return page;
}

/// Mostly one page; more where clusters are many or large.
std::vector<BuiltPage> buildPiece(const Soup& soup, std::span<const Reference> references,
                                  int stepExponent, std::uint32_t groupClusters) {
  BuildOptions options;
  options.chooseOrigin = false;
  options.stepExponent = stepExponent;
  const PageParts input(soup, references, std::ldexp(1.0f, stepExponent));
  const Mesh mesh = Mesh::build(input.parts, options);
  std::vector<BuiltPage> out;
  const std::uint32_t count = mesh.clusterCount();
  for (std::uint32_t first = 0; first < count;) {
    std::uint32_t end = first;
    std::size_t bytes = 0;
    while (end < count && end - first < kPageClusters && bytes < kPageBlobBytes)
      bytes += mesh.clusterBytes(end++).size();
    out.push_back(packPage(mesh, first, end, groupClusters));
    first = end;
  }
  if (!out.empty()) out.front().sizes = mesh.sizes();
  return out;
}

/// What is clustered at a time: chunks of one bucket, and whether they are its last.
struct Work {
  std::vector<SpillChunk> chunks;
  std::size_t bucket = 0;
  bool last = false;
};

/// Hands out work bucket by bucket; splits cells that are too large.
class WorkList {
 public:
  WorkList(const std::filesystem::path& file, const Spill& spill, std::span<const Bucket> buckets,
           std::size_t from, const StreamOptions& options)
      : file_(file, StreamFile::Mode::kAppend),
        spill_(spill),
        buckets_(buckets),
        next_(from),
        options_(options) {
    if (file_.size() < spill.fileBytes)
      throw std::invalid_argument("hccm: the spill file is shorter than its list says");
  }
  const StreamFile& file() const { return file_; }
  bool next(Work& out) {
    while (ready_.empty()) {
      if (next_ == buckets_.size()) return false;
      prepare(next_++);
    }
    out = std::move(ready_.front());
    ready_.pop_front();
    return true;
  }

 private:
  void prepare(std::size_t bucket) {
    Work work;
    work.bucket = bucket;
    std::uint64_t triangles = 0;
    for (std::size_t c = buckets_[bucket].first; c < buckets_[bucket].end; ++c)
      add(spill_.cells[c], 1, work, triangles);
    work.last = true;
    ready_.push_back(std::move(work));
  }
  void add(const SpillCell& cell, int spills, Work& work, std::uint64_t& triangles) {
    const std::uint64_t limit = options_.bucketTriangles();
    if (cell.triangles > limit && spills < kMostSpills && cell.lower != cell.upper) {
      for (const SpillCell& part : spillAgain(file_, cell, options_.spillBufferBytes()))
        add(part, spills + 1, work, triangles);
      return;
    }
    for (const SpillChunk& chunk : cell.chunks) {
      if (triangles > 0 && triangles + chunk.triangles > limit) {
        ready_.push_back({std::move(work.chunks), work.bucket, false});
        work.chunks = {};
        triangles = 0;
      }
      work.chunks.push_back(chunk);
      triangles += chunk.triangles;
    }
  }

  StreamFile file_;
  const Spill& spill_;
  std::span<const Bucket> buckets_;
  std::size_t next_;
  const StreamOptions& options_;
  std::deque<Work> ready_;
};

struct Done {
  std::vector<BuiltPage> pages;
  std::size_t bucket = 0;
  bool last = false;
};

}  // namespace

PageShape PageShape::forTriangles(std::uint64_t triangles) {
  // Small models have small pages, so that a small cache holds some; large ones have groups, so
  // that the hierarchy over them stays small.
  constexpr std::uint64_t kPages = 256, kLeast = 512, kMost = 8192;
  constexpr std::uint64_t kGroups = std::uint64_t{1} << 20, kFill = 220;
  return {std::clamp(triangles / kPages, kLeast, kMost),
          static_cast<std::uint32_t>(
              std::clamp<std::uint64_t>(triangles / kFill / kGroups, 1, kGroupClusters))};
}

std::vector<Bucket> planBuckets(const Spill& spill, const StreamOptions& options) {
  std::vector<Bucket> out;
  std::uint64_t triangles = 0;
  for (std::size_t c = 0; c < spill.cells.size(); ++c) {
    const std::uint64_t more = spill.cells[c].triangles;
    if (out.empty() || triangles + more > options.bucketTriangles()) {
      out.push_back({c, c});
      triangles = 0;
    }
    out.back().end = c + 1;
    triangles += more;
  }
  return out;
}

std::vector<BuiltPage> clusterChunks(const StreamFile& file, std::span<const SpillChunk> chunks,
                                     int stepExponent, const PageShape& shape) {
  std::vector<std::vector<BuiltPage>> built;
  {
    Soup soup;
    std::vector<std::byte> bytes;
    std::uint64_t triangles = 0;
    for (const SpillChunk& chunk : chunks) triangles += chunk.triangles;
    soup.corners.reserve(triangles);
    soup.kind.reserve(triangles);
    for (const SpillChunk& chunk : chunks) {
      readChunk(file, chunk, bytes);
      forRuns(bytes, [&](const RunHeader& h, std::span<const std::byte> run) { soup.add(h, run); });
    }
    std::vector<Reference> references = referencesOf(soup);
    const std::vector<Range> ranges = splitIntoPieces(references, shape.pageTriangles);
    built.resize(ranges.size());
    tbb::parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t i) {
      const std::span<const Reference> all(references);
      built[i] = buildPiece(soup, all.subspan(ranges[i].begin, ranges[i].end - ranges[i].begin),
                            stepExponent, shape.groupClusters);
    });
  }
  std::vector<BuiltPage> out;
  for (std::vector<BuiltPage>& some : built)
    for (BuiltPage& page : some) out.push_back(std::move(page));
  return out;
}

void buildPages(const std::filesystem::path& file, const Spill& spill,
                std::span<const Bucket> buckets, std::size_t from, const StreamOptions& options,
                const PageSink& sink, const std::function<void(std::size_t)>& done) {
  constexpr std::size_t kAtATime = 3;  // StreamOptions::bucketTriangles() knows
  const PageShape shape = PageShape::forTriangles(spill.kept);
  WorkList list(file, spill, buckets, from, options);
  tbb::parallel_pipeline(
      kAtATime,
      tbb::make_filter<void, Work>(tbb::filter_mode::serial_in_order, [&](tbb::flow_control&
                                                                              control) {
        Work work;
        if (!list.next(work)) control.stop();
        return work;
      }) & tbb::make_filter<Work, Done>(tbb::filter_mode::parallel, [&](const Work& work) {
        return Done{clusterChunks(list.file(), work.chunks, options.grid.stepExponent, shape),
                    work.bucket, work.last};
      }) & tbb::make_filter<Done, void>(tbb::filter_mode::serial_in_order, [&](const Done& d) {
        for (const BuiltPage& page : d.pages) sink(page);
        if (d.last) done(d.bucket);
        if (!options.keepGoing(double(d.bucket + 1) / double(buckets.size())))
          throw std::runtime_error("interrupted");
      }));
}

}  // namespace hccm
