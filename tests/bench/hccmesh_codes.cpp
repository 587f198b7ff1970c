// What ways of storing a cluster would take, on three kinds of meshes: cluster sizes, vertex codes,
// topology codes and node layouts, in bytes a triangle. Prints a table for docs/hccmesh.md.
//
//   hccmesh_codes [--triangles 1e6] [--precision 24]
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <CLI/CLI.hpp>
#include <bit>
#include <cmath>
#include <mutex>

#include "hccmesh/encode.h"
#include "tests/bench/bench_meshes.h"

namespace {

using namespace hccm;

// Bits of all clusters by code.
struct Bits {
  double triangles = 0, clusters = 0, leaves = 0, vertices = 0;
  double plainVertices = 0, planeVertices = 0, leafVertices = 0;
  double triples = 0, leafLists = 0, strips = 0, stripRefs = 0;
  double boxes8 = 0, boxes6 = 0;
  void add(const Bits& o) {
    const double* from = &o.triangles;
    for (double* to = &triangles; to <= &boxes6; ++to) *to += *from++;
  }
};

double widths(const glm::ivec3& extent) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) sum += std::bit_width(static_cast<std::uint32_t>(extent[k]));
  return sum;
}

// Widths if the best axis is stored as what is left of a plane through all vertices.
double planeWidths(const std::vector<VertexKey>& vertices, const glm::ivec3& lower,
                   const glm::ivec3& extent) {
  double least = widths(extent);
  for (int z = 0; z < 3; ++z) {
    const int x = (z + 1) % 3, y = (z + 2) % 3;
    glm::dvec3 mean(0.0);
    for (const VertexKey& v : vertices) mean += glm::dvec3(v.grid - lower);
    mean /= double(vertices.size());
    double xx = 1e-9, xy = 0, yy = 1e-9, xz = 0, yz = 0;
    for (const VertexKey& v : vertices) {
      const glm::dvec3 d = glm::dvec3(v.grid - lower) - mean;
      xx += d[x] * d[x], xy += d[x] * d[y], yy += d[y] * d[y];
      xz += d[x] * d[z], yz += d[y] * d[z];
    }
    const double det = xx * yy - xy * xy;
    if (!(det > 1e-12 * xx * yy)) continue;
    const auto slope = [](double s) { return std::round(s * 8192.0) / 8192.0; };
    const double a = slope((xz * yy - yz * xy) / det), b = slope((yz * xx - xz * xy) / det);
    if (std::abs(a) >= 4.0 || std::abs(b) >= 4.0) continue;
    double low = 1e30, high = -1e30;
    for (const VertexKey& v : vertices) {
      const glm::dvec3 d(v.grid - lower);
      const double rest = d[z] - std::round(a * d[x] + b * d[y]);
      low = std::min(low, rest), high = std::max(high, rest);
    }
    glm::ivec3 e = extent;
    if (high - low > 1e9) continue;
    e[z] = static_cast<int>(high - low);
    least = std::min(least, widths(e));
  }
  return least;
}

int bitsFor(std::size_t count) {
  return count > 1 ? static_cast<int>(std::bit_width(count - 1)) : 1;
}

Bits measure(const ClusterInput& in) {
  Bits b;
  b.clusters = 1;
  b.leaves = double(in.leaves.size());
  b.vertices = double(in.vertices.size());
  glm::ivec3 lower = in.vertices[0].grid, upper = lower;
  for (const VertexKey& v : in.vertices) lower = min(lower, v.grid), upper = max(upper, v.grid);
  b.plainVertices = b.vertices * widths(upper - lower);
  b.planeVertices = b.vertices * planeWidths(in.vertices, lower, upper - lower) + 40;
  const int index = bitsFor(in.vertices.size());
  glm::ivec3 leafExtent(0);
  std::uint16_t next = 0;
  for (const Strip& s : in.leaves) {
    const int triangles = std::popcount(s.starts);
    b.triangles += triangles;
    std::uint16_t seen[16];
    int locals = 0, old = 0, fresh = 0;
    glm::ivec3 low(INT32_MAX), high(INT32_MIN);
    for (std::uint32_t i = 0; i < s.size; ++i) {
      const std::uint16_t v = s.entries[i];
      low = min(low, in.vertices[v].grid), high = max(high, in.vertices[v].grid);
      if (std::find(seen, seen + locals, v) != seen + locals) {
        ++old;
        continue;
      }
      seen[locals++] = v;
      if (v == next) ++next, ++fresh;
    }
    leafExtent = max(leafExtent, high - low);
    const int refs = locals - fresh;
    b.leafLists += 3 + 10 + refs * index + triangles * 3 * bitsFor(std::size_t(locals));
    b.strips += 4 + 2 * (s.size - 3) + locals + 4 * old + 8 + 10 + 3;  // 3: rounded to bytes
    b.stripRefs += refs * index;
  }
  b.leafVertices = b.vertices * widths(leafExtent) + 2 * b.stripRefs / index;  // longer references
  b.triples = b.triangles * 3 * index + 8 * b.leaves;
  b.boxes8 = 48 * b.leaves;
  b.boxes6 = 36 * b.leaves + 48 * std::ceil(b.leaves / 8);
  return b;
}

Bits measureMesh(const trex::Mesh& mesh, int precision, const SplitLimits& limits) {
  Part part;
  part.positions = mesh.positions;
  part.triangles = mesh.triangles;
  BuildOptions options;
  options.precisionBits = precision;
  const Mesh built = Mesh::build({&part, 1}, options);
  const Grid grid{built.gridOrigin(), 1.0 / built.step(), std::ilogb(built.step())};
  const Source source{part};
  std::vector<Reference> references;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const glm::uvec3 c = mesh.triangles[t];
    const glm::ivec3 p = source.gridPosition(c.x, grid), q = source.gridPosition(c.y, grid),
                     r = source.gridPosition(c.z, grid);
    if (p == q || q == r || r == p) continue;
    const glm::vec3 low(min(p, min(q, r))), high(max(p, max(q, r)));
    references.push_back({{low.x, low.y, low.z}, 0, {high.x, high.y, high.z}, t});
  }
  const std::vector<Range> pieces = splitIntoPieces(references);
  Bits all;
  std::mutex mutex;
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    Bits sum;
    forEachCluster({&source, 1}, grid,
                   std::span(references).subspan(pieces[i].begin, pieces[i].end - pieces[i].begin),
                   limits, [&](const ClusterInput& in) { sum.add(measure(in)); });
    const std::lock_guard lock(mutex);
    all.add(sum);
  });
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  double triangles = 1e6;
  int precision = 24;
  CLI::App app("Codes of HCCMesh compared");
  app.add_option("--triangles", triangles)->check(CLI::Range(1e3, 1e8));
  app.add_option("--precision", precision)->check(CLI::Range(8, 24));
  CLI11_PARSE(app, argc, argv);
  fmt::print(
      "| mesh | cluster | spare leaves | triangles a cluster | a leaf | vertices a triangle "
      "| vertices: cluster box | with a plane | leaf boxes | topology: triples | leaf lists "
      "| strips | of that references | boxes 8 bits | 6 bits |\n");
  fmt::print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const char* kind : {"scan", "assembly", "terrain"}) {
    const trex::Mesh mesh = trex::bench::meshOfKind(kind, triangles);
    for (std::size_t size : {64u, 128u, 256u, 512u})
      for (std::size_t spare : {4u, 8u, 32u}) {
        if (spare != 8 && size != 256) continue;
        SplitLimits limits;
        limits.triangles = size;
        limits.vertices = std::max<std::size_t>(256, size);
        limits.leaves = 128;
        limits.spareLeaves = spare;
        const Bits b = measureMesh(mesh, precision, limits);
        const auto share = [&](double bits) { return bits / 8.0 / b.triangles; };
        fmt::print(
            "| {} | {} | 1/{} | {:.0f} | {:.2f} | {:.3f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} "
            "| {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n",
            kind, size, spare, b.triangles / b.clusters, b.triangles / b.leaves,
            b.vertices / b.triangles, share(b.plainVertices), share(b.planeVertices),
            share(b.leafVertices), share(b.triples), share(b.leafLists),
            share(b.strips + b.stripRefs), share(b.stripRefs), share(b.boxes8), share(b.boxes6));
      }
  }
  return 0;
}
