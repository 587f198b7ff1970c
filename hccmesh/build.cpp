// Mesh::build: grid, references, pieces, blobs, one buffer.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include "hccmesh/encode.h"
#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/validate.h"

namespace hccm {
namespace {

constexpr std::size_t kGrain = 1u << 13;  // triangles a task

struct Extent {
  glm::dvec3 lower{std::numeric_limits<double>::infinity()};
  glm::dvec3 upper{-std::numeric_limits<double>::infinity()};
  void extend(const Extent& e) {
    lower = glm::min(lower, e.lower);
    upper = glm::max(upper, e.upper);
  }
  bool empty() const { return !(lower.x <= upper.x); }
};

bool isFinite(const glm::dvec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

[[noreturn]] void refuse(const std::string& what) { throw std::invalid_argument("hccm: " + what); }

Source makeSource(const Part& part) {
  Source s;
  s.part = part;
  const std::size_t n = part.positions.size();
  const auto fits = [n](std::size_t size) { return size == 0 || size == n; };
  if (!fits(part.normals.size()) || !fits(part.texCoords.size()) || !fits(part.colors.size()) ||
      !fits(part.secondTexCoords.size()))
    refuse("an attribute array is not as long as positions");
  if (part.texCoords.empty() && !part.secondTexCoords.empty())
    refuse("there are second texture coordinates, but no first ones");
  if (part.triangles.size() > std::numeric_limits<std::uint32_t>::max())
    refuse("a part has 2^32 triangles or more");
  const glm::dmat3 linear(part.transform);
  for (int k = 0; k < 4; ++k)
    if (!isFinite(glm::dvec3(part.transform[k]))) refuse("a transform is not finite");
  const double determinant = glm::determinant(linear);
  s.mirrored = determinant < 0.0;
  // The cofactor matrix is the inverse transpose but for a factor, and exists for flat transforms.
  const glm::dvec3 x = glm::cross(linear[1], linear[2]), y = glm::cross(linear[2], linear[0]),
                   z = glm::cross(linear[0], linear[1]);
  s.normalMatrix = glm::dmat3(x, y, z) * (s.mirrored ? -1.0 : 1.0);
  s.flags =
      static_cast<std::uint8_t>((part.normals.empty() ? 0 : layout::kNormals) |
                                (part.texCoords.empty() ? 0 : layout::kTexCoords) |
                                (part.colors.empty() ? 0 : layout::kColors) |
                                (part.secondTexCoords.empty() ? 0 : layout::kSecondTexCoords));
  return s;
}

bool isFinite(const Source& s, const glm::uvec3& t) {
  return isFinite(s.transformed(t.x)) && isFinite(s.transformed(t.y)) &&
         isFinite(s.transformed(t.z));
}

// Bounds of all corners of finite triangles; checks indices on the way.
Extent extentOf(const Source& s) {
  const auto count = static_cast<std::uint32_t>(s.part.positions.size());
  return tbb::parallel_reduce(
      tbb::blocked_range<std::size_t>(0, s.part.triangles.size(), kGrain), Extent(),
      [&](const tbb::blocked_range<std::size_t>& range, Extent e) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          const glm::uvec3 t = s.part.triangles[i];
          if (t.x >= count || t.y >= count || t.z >= count)
            refuse("a vertex index is out of range");
          const glm::dvec3 p[3] = {s.transformed(t.x), s.transformed(t.y), s.transformed(t.z)};
          if (!isFinite(p[0]) || !isFinite(p[1]) || !isFinite(p[2])) continue;
          for (const glm::dvec3& q : p) e.extend(Extent{q, q});
        }
        return e;
      },
      [](Extent a, const Extent& b) {
        a.extend(b);
        return a;
      });
}

Grid chooseGrid(const Extent& e, const BuildOptions& options) {
  if (options.precisionBits < 8 || options.precisionBits > 24) refuse("precisionBits is not 8..24");
  if (!options.chooseOrigin && !isFinite(options.gridOrigin)) refuse("gridOrigin is not finite");
  Grid g;
  g.origin = options.chooseOrigin ? glm::dvec3(0.0) : options.gridOrigin;
  if (e.empty()) {
    g.stepExponent = options.stepExponent.value_or(0);
    g.cells = std::ldexp(1.0, -g.stepExponent);
    return g;
  }
  if (options.chooseOrigin) g.origin = e.lower * 0.5 + e.upper * 0.5;
  const glm::dvec3 size = e.upper - e.lower;
  const glm::dvec3 reach = glm::max(glm::abs(e.lower - g.origin), glm::abs(e.upper - g.origin));
  const double largest = std::max({size.x, size.y, size.z});
  const double furthest = std::max({reach.x, reach.y, reach.z});
  if (!(largest <= 1e30) || !(furthest <= 1e30)) refuse("the extent is over 1e30 metres");
  // Least exponents with largest <= 2^bits cells and furthest <= 2^23 cells.
  const auto exponentFor = [](double length, int bits) {
    int exponent = layout::kMinStepExponent;
    if (length > 0.0) std::frexp(length, &exponent), exponent -= bits;
    if (length > 0.0 && std::ldexp(length, -exponent) <= std::ldexp(1.0, bits - 1)) --exponent;
    return std::max(exponent, layout::kMinStepExponent);
  };
  g.stepExponent = std::max(exponentFor(largest, options.precisionBits), exponentFor(furthest, 23));
  if (largest == 0.0 && furthest == 0.0) g.stepExponent = -24;
  if (options.stepExponent) {
    if (*options.stepExponent < exponentFor(furthest, 23)) refuse("the step given is too small");
    g.stepExponent = *options.stepExponent;
  }
  g.cells = std::ldexp(1.0, -g.stepExponent);
  return g;
}

// Half a cell's diagonal, and the rounding of the transform in double.
double errorBoundOf(const Extent& e, const Grid& g, std::span<const Source> sources) {
  if (e.empty()) return 0.0;
  glm::dvec3 moved(0.0);
  for (const Source& s : sources)
    moved = glm::max(moved, glm::abs(glm::dvec3(s.part.transform[3])));
  const glm::dvec3 reach =
      glm::max(glm::abs(e.lower), glm::abs(e.upper)) + glm::abs(g.origin) + moved;
  return std::sqrt(0.75) / g.cells + 8.0 * 0x1p-53 * (reach.x + reach.y + reach.z);
}

using GroupKey = std::tuple<std::uint32_t, std::uint32_t, std::uint8_t>;

// References of a group's triangles that have three different corners on the grid.
std::vector<Reference> referencesOf(std::span<const Source> sources,
                                    const std::vector<std::uint32_t>& group, const Grid& grid) {
  constexpr std::uint32_t kDropped = 0xffffffffu;
  std::size_t count = 0;
  for (std::uint32_t i : group) count += sources[i].part.triangles.size();
  std::vector<Reference> out(count);
  std::size_t base = 0;
  for (std::uint32_t number : group) {
    const Source& s = sources[number];
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, s.part.triangles.size(), kGrain),
        [&](const tbb::blocked_range<std::size_t>& range) {
          for (std::size_t i = range.begin(); i < range.end(); ++i) {
            Reference& r = out[base + i];
            r.source = kDropped;
            const glm::uvec3 t = s.part.triangles[i];
            if (!isFinite(s, t)) continue;
            const glm::ivec3 a = s.gridPosition(t.x, grid), b = s.gridPosition(t.y, grid),
                             c = s.gridPosition(t.z, grid);
            if (a == b || b == c || c == a) continue;
            const glm::vec3 lower(glm::min(a, glm::min(b, c))), upper(glm::max(a, glm::max(b, c)));
            r = {{lower.x, lower.y, lower.z},
                 number,
                 {upper.x, upper.y, upper.z},
                 static_cast<std::uint32_t>(i)};
          }
        });
    base += s.part.triangles.size();
  }
  std::erase_if(out, [](const Reference& r) { return r.source == kDropped; });
  return out;
}

struct Piece {
  std::vector<std::byte> blobs;
  std::vector<std::uint32_t> sizes;
};

// One buffer out of all pieces, in their order.
Bytes assemble(layout::Header& header, std::vector<Piece>& pieces) {
  std::uint64_t clusters = 0, bytes = 0;
  std::vector<std::uint64_t> firstCluster, firstByte;
  for (const Piece& p : pieces) {
    firstCluster.push_back(clusters);
    firstByte.push_back(bytes);
    clusters += p.sizes.size();
    bytes += p.blobs.size();
  }
  const std::uint64_t start = layout::firstBlob(clusters);
  header.byteSize = start + bytes + layout::kTailBytes;
  if (clusters >= TopNode::kCluster || header.byteSize >> layout::kTableShift > 0xffffffffu)
    refuse("the mesh is over 64 GiB");
  header.clusterCount = static_cast<std::uint32_t>(clusters);
  Bytes out(header.byteSize);
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    Piece& p = pieces[i];
    std::uint64_t at = start + firstByte[i];
    if (!p.blobs.empty()) std::memcpy(out.data() + at, p.blobs.data(), p.blobs.size());
    std::byte* entry = out.data() + sizeof(header) + 4 * firstCluster[i];
    for (std::uint32_t size : p.sizes) {
      const auto word = static_cast<std::uint32_t>(at >> layout::kTableShift);
      std::memcpy(entry, &word, 4);
      entry += 4;
      at += size;
    }
    p = {};
  });
  std::memcpy(out.data(), &header, sizeof(header));
  header.checksum = checksumOf(out);
  std::memcpy(out.data(), &header, sizeof(header));
  return out;
}

}  // namespace

Mesh Mesh::build(std::span<const Part> parts, const BuildOptions& options) {
  std::vector<Source> sources;
  Extent extent;
  std::uint64_t given = 0;
  for (const Part& part : parts) {
    sources.push_back(makeSource(part));
    extent.extend(extentOf(sources.back()));
    given += part.triangles.size();
  }
  const Grid grid = chooseGrid(extent, options);

  std::map<GroupKey, std::vector<std::uint32_t>> groups;
  for (std::uint32_t i = 0; i < sources.size(); ++i)
    groups[{sources[i].part.material, sources[i].part.object, sources[i].flags}].push_back(i);

  layout::Header header{};
  std::memcpy(header.magic, layout::kMagic, 4);
  header.version = layout::kVersion;
  header.stepExponent = grid.stepExponent;
  header.errorBound = errorBoundOf(extent, grid, sources);
  for (int k = 0; k < 3; ++k) header.gridOrigin[k] = grid.origin[k];

  std::vector<Piece> pieces;
  glm::vec3 lower(std::numeric_limits<float>::infinity()), upper(-lower);
  for (const auto& [key, group] : groups) {
    std::vector<Reference> references = referencesOf(sources, group, grid);
    for (const Reference& r : references) {
      lower = glm::min(lower, glm::vec3(r.lower[0], r.lower[1], r.lower[2]));
      upper = glm::max(upper, glm::vec3(r.upper[0], r.upper[1], r.upper[2]));
    }
    header.triangleCount += references.size();
    const std::vector<Range> ranges = splitIntoPieces(references);
    const std::size_t first = pieces.size();
    pieces.resize(first + ranges.size());
    tbb::parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t i) {
      const std::span<const Reference> piece =
          std::span(references).subspan(ranges[i].begin, ranges[i].end - ranges[i].begin);
      encodePiece(sources, grid, piece, pieces[first + i].blobs, pieces[first + i].sizes);
    });
  }
  header.droppedTriangles = given - header.triangleCount;
  for (int k = 0; k < 3 && header.triangleCount > 0; ++k) {
    header.lower[k] = static_cast<std::int32_t>(lower[k]);
    header.upper[k] = static_cast<std::int32_t>(upper[k]);
  }
  return Mesh(assemble(header, pieces));
}

}  // namespace hccm
