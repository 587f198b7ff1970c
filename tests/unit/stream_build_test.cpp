// Streaming builds: the same triangles as in memory, bounded buckets, hostile inputs, equal bytes.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <limits>
#include <map>

#include "hccmesh/stream_cells.h"
#include "tests/unit/stream_meshes.h"

namespace hccm::test {
namespace {

using Key = std::array<std::int64_t, 9>;

/// A triangle by its corners on a grid, from the least corner on.
Key keyOf(const Triangle& t, double step) {
  std::array<std::array<std::int64_t, 3>, 3> p;
  for (int k = 0; k < 3; ++k)
    for (int axis = 0; axis < 3; ++axis)
      p[k][axis] = static_cast<std::int64_t>(std::llround(t.position[k][axis] / step));
  std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
  Key key;
  for (int k = 0; k < 3; ++k) std::copy(p[k].begin(), p[k].end(), key.begin() + 3 * k);
  return key;
}

using Triangles = std::multimap<Key, Triangle>;

Triangles trianglesOf(const PagedMesh& mesh) {
  Triangles out;
  for (std::uint32_t p = 0; p < mesh.table().pages.size(); ++p) {
    const PagedMesh::Pin pin = mesh.page(p);
    for (std::uint32_t c = 0; c < pin.mesh().clusterCount(); ++c)
      pin.mesh().forTriangles(c, [&](std::uint32_t i) {
        const Triangle t = pin.mesh().triangle(c, i);
        out.emplace(keyOf(t, mesh.step()), t);
      });
  }
  return out;
}

Triangles trianglesOf(const Mesh& mesh) {
  Triangles out;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c)
    mesh.forTriangles(c, [&](std::uint32_t i) {
      const Triangle t = mesh.triangle(c, i);
      out.emplace(keyOf(t, mesh.step()), t);
    });
  return out;
}

void addCorners(Soup& soup, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  soup.positions.push_back(a);
  soup.positions.push_back(b);
  soup.positions.push_back(c);
}

/// The mesh that a build in memory makes on the same grid.
Mesh inMemory(const Soup& soup, int stepExponent) {
  BuildOptions options;
  options.chooseOrigin = false;
  options.stepExponent = stepExponent;
  return build(soup, options);
}

TEST(StreamBuild, TheSameTrianglesAsInMemory) {
  Soup soup = withSecondSet(randomSoup(30'000, 3.0f, 5), 1.0f);
  Streamed s = stream(soup);
  EXPECT_GT(s.buckets, 1u);
  const Mesh whole = inMemory(soup, s.table.stepExponent);
  EXPECT_EQ(s.table.triangles, whole.triangleCount());
  EXPECT_EQ(s.spill.flat, whole.droppedTriangles());
  const Triangles streamed = trianglesOf(s.mesh()), expected = trianglesOf(whole);
  ASSERT_EQ(streamed.size(), expected.size());
  for (auto a = streamed.begin(), b = expected.begin(); a != streamed.end(); ++a, ++b) {
    ASSERT_EQ(a->first, b->first);
    if (streamed.count(a->first) > 1) continue;
    // Normals go through 32 bits twice; corners may start elsewhere.
    ASSERT_TRUE(a->second.hasNormals && a->second.hasTexCoords && a->second.hasColors);
    ASSERT_TRUE(a->second.hasSecondTexCoords);
    glm::vec3 sumA(0.0f), sumB(0.0f);
    glm::vec4 colorA(0.0f), colorB(0.0f);
    for (int k = 0; k < 3; ++k) {
      sumA += a->second.normal[k], sumB += b->second.normal[k];
      colorA += a->second.color[k], colorB += b->second.color[k];
      // Where the position is, by the corner.
      const glm::vec2 uv = a->second.secondTexCoord[k];
      ASSERT_LT(glm::length(uv - glm::vec2(a->second.position[k].y, a->second.position[k].x)),
                1e-5f + 0x1p-15f);
    }
    ASSERT_LT(glm::length(sumA - sumB), 3e-4f);
    ASSERT_LT(glm::length(colorA - colorB), 1e-5f);
  }
}

TEST(StreamBuild, EqualBytesForAnyNumberOfThreads) {
  const Soup soup = randomSoup(40'000, 1.0f, 9);
  std::vector<std::byte> pages, table;
  for (const std::size_t threads : {1u, 2u, 5u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Streamed s = stream(soup, 3);
    if (threads == 1) pages = s.pages->bytes, table = s.table.toBytes();
    EXPECT_EQ(s.pages->bytes, pages) << threads;
    EXPECT_EQ(s.table.toBytes(), table) << threads;
  }
}

TEST(StreamBuild, MaterialsAndObjectsStay) {
  const Soup soup = sheet(60);
  Streamed s = stream(soup, 3);
  const PagedMesh mesh = s.mesh();
  std::map<std::uint32_t, std::uint64_t> count;
  for (const auto& [key, t] : trianglesOf(mesh)) {
    EXPECT_EQ(t.object, t.material * 7);
    ++count[t.material];
  }
  EXPECT_EQ(count.size(), 3u);
  EXPECT_EQ(count[0], 2400u);
  EXPECT_EQ(count[1], 2400u);
  EXPECT_EQ(count[2], 2400u);
}

TEST(StreamBuild, ManyObjectsOfOneTriangleMakeMorePages) {
  const Soup soup = randomSoup(9000, 1.0f, 2);
  Soup bare;
  bare.positions = soup.positions, bare.triangles = soup.triangles;
  const Streamed s = stream(bare, 900);
  std::uint64_t triangles = 0;
  for (const PageEntry& p : s.table.pages) {
    EXPECT_LE(p.clusters, kPageClusters);
    triangles += p.triangles;
  }
  EXPECT_EQ(triangles, s.spill.kept);
}

TEST(StreamBuild, OneTriangle) {
  Soup soup;
  addCorners(soup, glm::vec3(0, 0, 0), glm::vec3(1, 0, 0), glm::vec3(0, 1, 0));
  soup.triangles = {{0, 1, 2}};
  Streamed s = stream(soup);
  EXPECT_EQ(s.table.triangles, 1u);
  EXPECT_EQ(s.table.pages.size(), 1u);
  const Triangle t = s.mesh().triangle(0, 0);
  EXPECT_EQ(t.position[1], glm::vec3(1, 0, 0));
}

TEST(StreamBuild, NoTriangleAtAll) {
  const Streamed s = stream(Soup());
  EXPECT_EQ(s.table.pages.size(), 0u);
  EXPECT_EQ(PageTable::fromBytes(s.table.toBytes(), 0).triangles, 0u);
}

TEST(StreamBuild, NonFiniteAndFlatTrianglesAreDroppedAndCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  Soup soup;
  addCorners(soup, glm::vec3(0, 0, 0), glm::vec3(1, 0, 0), glm::vec3(0, 1, 0));
  addCorners(soup, glm::vec3(nan, 0, 0), glm::vec3(0, inf, 0), glm::vec3(0, 0, -inf));
  soup.triangles = {{0, 1, 2}, {0, 1, 3}, {4, 1, 2}, {0, 5, 2}, {0, 0, 1}, {2, 1, 2}};
  const Streamed s = stream(soup);
  EXPECT_EQ(s.spill.given, 6u);
  EXPECT_EQ(s.spill.nonFinite, 3u);
  EXPECT_EQ(s.spill.flat, 2u);
  EXPECT_EQ(s.table.triangles, 1u);
}

TEST(StreamBuild, AllTrianglesInOnePlace) {
  Soup soup;  // 40000 with one centre: no cell tells them apart
  for (int i = 0; i < 40'000; ++i) {
    const float r = 1e-3f + 1e-6f * static_cast<float>(i);
    const auto v = static_cast<std::uint32_t>(soup.positions.size());
    addCorners(soup, glm::vec3(-r, -r, 0), glm::vec3(r, 0, 0), glm::vec3(0, r, 0));
    soup.triangles.push_back({v, v + 1, v + 2});
  }
  addCorners(soup, glm::vec3(100, 100, 100), glm::vec3(101, 100, 100), glm::vec3(100, 101, 100));
  soup.triangles.push_back({120'000, 120'001, 120'002});
  const Streamed s = stream(soup);
  EXPECT_EQ(s.table.triangles + s.spill.flat, 40'001u);
  EXPECT_GT(s.table.triangles, 35'000u);
}

TEST(StreamBuild, OneCrowdedCornerIsSplitAgain) {
  Soup soup = sheet(150, 1e-3f);  // 45000 triangles in one cell of the first spill
  addCorners(soup, glm::vec3(900, 0, 0), glm::vec3(901, 0, 0), glm::vec3(900, 1, 800));
  const auto n = static_cast<std::uint32_t>(soup.positions.size());
  soup.triangles.push_back({n - 3, n - 2, n - 1});
  const Streamed s = stream(soup);
  EXPECT_EQ(s.table.triangles, s.spill.kept);
  // Pages stay small in space although all were in one cell.
  for (const PageEntry& p : s.table.pages) EXPECT_LE(p.triangles, 8192u);
}

TEST(StreamBuild, EverythingInOnePlane) {
  Soup soup = sheet(100);
  for (glm::vec3& p : soup.positions) p.y = 7.0f;
  const Streamed s = stream(soup);
  EXPECT_EQ(s.table.triangles + s.spill.flat, 20'000u);
}

TEST(StreamBuild, TrianglesBeyondTheBoundsAreAnError) {
  const Soup soup = sheet(4);
  EXPECT_THROW(stream(SoupSource(soup), glm::dvec3(-0.1), glm::dvec3(0.1)), std::invalid_argument);
  std::filesystem::remove(spillPath());
}

TEST(StreamBuild, BoundsOutOfRangeAreAnError) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(StreamGrid::make(glm::dvec3(0.0), glm::dvec3(nan), 24), std::invalid_argument);
  EXPECT_THROW(StreamGrid::make(glm::dvec3(1.0), glm::dvec3(0.0), 24), std::invalid_argument);
  EXPECT_THROW(StreamGrid::make(glm::dvec3(0.0), glm::dvec3(1e31), 24), std::invalid_argument);
  EXPECT_THROW(StreamGrid::make(glm::dvec3(0.0), glm::dvec3(1.0), 25), std::invalid_argument);
}

TEST(StreamBuild, ExtentsFromMicrometresToTenThousandKilometres) {
  for (const float extent : {1e-6f, 1.0f, 1e7f}) {
    Streamed s = stream(sheet(20, extent));
    EXPECT_EQ(s.table.triangles, 800u) << extent;
    const PagedMesh mesh = s.mesh();
    EXPECT_LE(mesh.step(), extent * 0x1p-22) << extent;
  }
}

TEST(StreamBuild, ADamagedSpillIsNoticed) {
  const Soup soup = sheet(40);
  StreamOptions options;
  options.grid = StreamGrid::make(glm::dvec3(-1.0), glm::dvec3(1.0), 24);
  const std::filesystem::path file = spillPath();
  const Spill spill = spillTriangles(SoupSource(soup), options, file);
  {
    StreamFile out(file, StreamFile::Mode::kAppend);
    std::byte b[1];
    out.read(spill.fileBytes / 2, b);
    b[0] ^= std::byte{4};
    out.write(spill.fileBytes / 2, b);
  }
  const auto buildAll = [&] {
    buildPages(
        file, spill, planBuckets(spill, options), 0, options, [](const BuiltPage&) {},
        [](std::size_t) {});
  };
  EXPECT_THROW(buildAll(), FormatError);
  std::filesystem::resize_file(file, spill.fileBytes - 1);
  EXPECT_THROW(buildAll(), std::invalid_argument);
  std::filesystem::remove(file);
  EXPECT_THROW(buildAll(), FileError);
}

TEST(StreamBuild, ItsListComesBackFromBytes) {
  const Soup soup = sheet(40);
  const Streamed s = stream(soup);
  const std::vector<std::byte> bytes = s.spill.toBytes();
  EXPECT_EQ(Spill::fromBytes(bytes).toBytes(), bytes);
  for (std::size_t n = 0; n < bytes.size(); n += 8)
    EXPECT_THROW(Spill::fromBytes(std::span(bytes).first(n)), FormatError) << n;
}

TEST(StreamBuild, CellsFollowTheirTree) {
  const CellGrid grid(glm::ivec3(-1000, 0, 5), glm::ivec3(1000, 10, 900), 12);
  EXPECT_EQ(grid.bits(), 12);
  for (std::int32_t x = -1000; x <= 1000; x += 37)
    for (std::int32_t z = 5; z <= 900; z += 41) {
      const Corners9 c = {x, 3, z, x, 3, z, x, 3, z};
      const std::uint32_t cell = grid.cellOf(c);
      ASSERT_LT(cell, grid.cells());
      glm::ivec3 lower, upper;
      grid.boundsOf(cell, lower, upper);
      EXPECT_TRUE(lower.x <= x && x <= upper.x && lower.z <= z && z <= upper.z) << x << " " << z;
    }
  // The first cut is across the longest axis.
  const Corners9 left = {-999, 0, 5, -999, 0, 5, -999, 0, 5},
                 right = {999, 10, 900, 999, 10, 900, 999, 10, 900};
  EXPECT_LT(grid.cellOf(left), grid.cells() / 2);
  EXPECT_GE(grid.cellOf(right), grid.cells() / 2);
}

// Counts that no machine here holds: sums, offsets and lists are 64 bits wide.
TEST(StreamBuild, BeyondFourThousandMillionTriangles) {
  PageTable table;
  BuiltPage page;
  page.entry.packedBytes = 3'000'000;
  page.entry.bytes = 4'000'000;
  page.entry.clusters = 100;
  page.entry.triangles = 100 * 128;
  page.groups.assign(100, PageGroup{});
  for (std::uint16_t i = 0; i < 100; ++i) page.groups[i].first = i, page.groups[i].count = 1;
  constexpr std::uint64_t kPages = 400'000;
  page.groups.resize(13);
  page.entry.clusters = 104, page.entry.triangles = 104 * 128;
  for (std::uint16_t i = 0; i < 13; ++i) page.groups[i].first = 8 * i, page.groups[i].count = 8;
  for (std::uint64_t i = 0; i < kPages; ++i) table.add(page);
  EXPECT_GT(table.triangles, std::uint64_t{1} << 32);
  EXPECT_EQ(table.triangles, kPages * 104 * 128);
  EXPECT_EQ(table.packedBytes(), kPages * 3'000'000);
  EXPECT_EQ(table.bytes(), kPages * 4'000'000);
  const PageTable again = PageTable::fromBytes(table.toBytes(), table.packedBytes());
  EXPECT_EQ(again.triangles, table.triangles);
  EXPECT_EQ(again.pages.back().offset, (kPages - 1) * 3'000'000);

  Spill spill;
  spill.given = spill.kept = 6'000'000'000;
  spill.fileBytes = spill.kept * 27;
  for (std::uint64_t i = 0; i < 6000; ++i) {
    SpillCell& cell = spill.cells.emplace_back();
    cell.triangles = 1'000'000;
    cell.chunks.push_back({i * 27'000'000, i, 27'000'000, 1'000'000});
  }
  const Spill back = Spill::fromBytes(spill.toBytes());
  EXPECT_EQ(back.cells.back().chunks[0].offset, 5999ull * 27'000'000);
  StreamOptions options;
  const std::vector<Bucket> buckets = planBuckets(back, options);
  EXPECT_EQ(buckets.back().end, 6000u);
  EXPECT_EQ(PageShape::forTriangles(spill.kept).groupClusters, kGroupClusters);
}

}  // namespace
}  // namespace hccm::test
