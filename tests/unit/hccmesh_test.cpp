// What goes in comes out: positions within the stated bound, attributes, extremes, determinism.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "hccmesh_meshes.h"

using namespace hccm;
using namespace hccm::test;

namespace {

// Every triangle of the mesh by its rounded colour-free identity: the source triangle whose corners
// are nearest. Sources here carry their number in the colour of the first corner.
Soup numbered(Soup s) {
  s.colors.assign(s.positions.size(), glm::u8vec4(0));
  for (std::size_t i = 0; i < s.triangles.size(); ++i)
    for (int k = 0; k < 3; ++k)
      s.colors[s.triangles[i][k]] = glm::u8vec4(i & 255, i >> 8 & 255, i >> 16 & 255, k);
  return s;
}

template <typename Visit>
void forEachTriangle(const Mesh& mesh, const Visit& visit) {
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c)
    test::forEachTriangle(mesh, c, [&](std::uint32_t t) { visit(c, mesh.triangle(c, t)); });
}

// Checks positions, order of corners and attributes of unconnected triangles.
void expectRoundTrip(const Soup& plain, const Mesh& mesh) {
  const Soup s = numbered(plain);
  ASSERT_EQ(mesh.triangleCount() + mesh.droppedTriangles(), s.triangles.size());
  std::vector<int> seen(s.triangles.size());
  forEachTriangle(mesh, [&](std::uint32_t, const Triangle& t) {
    const glm::ivec4 code(glm::round(t.color[0] * 255.0f));
    const auto number = static_cast<std::size_t>(code.x + 256 * code.y + 65536 * code.z);
    ASSERT_LT(number, s.triangles.size());
    ++seen[number];
    for (int k = 0; k < 3; ++k) {  // a triangle may begin at any of its corners
      const auto v = s.triangles[number][(k + code.w) % 3];
      const glm::dvec3 p = glm::dvec3(t.position[k]) + mesh.gridOrigin();
      EXPECT_LE(glm::length(p - glm::dvec3(s.positions[v])), mesh.errorBound());
      if (!s.normals.empty()) {
        EXPECT_LT(glm::length(glm::dvec3(t.normal[k]) - glm::dvec3(s.normals[v])), 7e-5);
        EXPECT_LT(glm::length(t.texCoord[k] - s.texCoords[v]), 0x1p-15f);
      }
    }
  });
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 1),
            static_cast<std::ptrdiff_t>(mesh.triangleCount()));
}

Soup fromPoints(std::vector<glm::vec3> points) {
  Soup s;
  s.positions = std::move(points);
  for (std::uint32_t i = 0; i + 2 < s.positions.size(); i += 3)
    s.triangles.push_back({i, i + 1, i + 2});
  return s;
}

}  // namespace

TEST(HccMesh, RoundTripOfASoupWithAllAttributes) {
  const Soup s = numbered(randomSoup(3000, 2.0f, 1));
  const Mesh mesh = build(s);
  EXPECT_LE(mesh.errorBound(), 3.0 * 2.0 * 0x1p-24 * 2.0);
  EXPECT_EQ(mesh.droppedTriangles(), 0u);
  expectRoundTrip(s, mesh);
}

TEST(HccMesh, ErrorBoundHoldsForEveryPrecision) {
  for (int bits : {8, 12, 17, 24}) {
    BuildOptions options;
    options.precisionBits = bits;
    const Soup s = numbered(randomSoup(300, 1.0f, 2));
    const Mesh mesh = build(s, options);
    EXPECT_LE(mesh.errorBound(), 4.0 * std::ldexp(1.0, -bits) * 2.0) << bits;
    expectRoundTrip(s, mesh);
  }
}

TEST(HccMesh, ExtentsFromMicrometresToTenThousandKilometres) {
  for (float extent : {1e-6f, 1e-3f, 1.0f, 1e7f, 1e29f, 1e-25f}) {
    const Soup s = numbered(randomSoup(200, extent, 3));
    const Mesh mesh = build(s);
    EXPECT_LT(mesh.errorBound(), 1e-6 * extent) << extent;
    expectRoundTrip(s, mesh);
  }
}

TEST(HccMesh, FarFromTheOriginThroughADoubleTransform) {
  const Soup s = numbered(randomSoup(500, 1.0f, 4));
  Part part = s.part();
  part.transform[3] = glm::dvec4(5e6, -5e6, 3e6, 1.0);
  const Mesh mesh = Mesh::build({&part, 1});
  EXPECT_LT(mesh.errorBound(), 1e-6);
  forEachTriangle(mesh, [&](std::uint32_t, const Triangle& t) {
    const glm::ivec4 code(glm::round(t.color[0] * 255.0f));
    const glm::dvec3 source(s.positions[s.triangles[code.x + 256 * code.y][code.w]]);
    const glm::dvec3 p =
        glm::dvec3(t.position[0]) + mesh.gridOrigin() - glm::dvec3(part.transform[3]);
    EXPECT_LE(glm::length(p - source), mesh.errorBound());
  });
}

TEST(HccMesh, SmallUvRangesAreQuantisedAndLargeOnesAreFloats) {
  Soup s = sheet(8);
  for (const glm::vec3& p : s.positions) s.texCoords.push_back(glm::vec2(p) + 0.5f);
  const auto small = build(s).sizes().texCoords;
  for (glm::vec2& uv : s.texCoords) uv *= 1000.0f;
  const Mesh large = build(s);
  EXPECT_LT(small, large.sizes().texCoords);
  forEachTriangle(large, [&](std::uint32_t, const Triangle& t) {
    for (int k = 0; k < 3; ++k)
      EXPECT_LT(glm::length(t.texCoord[k] / 1000.0f - 0.5f - glm::vec2(t.position[k])), 1e-6f);
  });
}

TEST(HccMesh, ASecondSetOfTexCoordsBesidesTheFirst) {
  for (const float scale : {0.5f, 1000.0f}) {
    Soup s = sheet(30);
    for (const glm::vec3& p : s.positions) s.texCoords.push_back(glm::vec2(p) + 0.5f);
    const Mesh one = build(s), two = build(withSecondSet(s, scale));
    EXPECT_EQ(two.sizes().total(), two.bytes().size());
    EXPECT_GT(two.sizes().texCoords, one.sizes().texCoords);
    EXPECT_FALSE(one.triangle(0, 0).hasSecondTexCoords);
    forEachTriangle(two, [&](std::uint32_t, const Triangle& t) {
      ASSERT_TRUE(t.hasTexCoords && t.hasSecondTexCoords);
      for (int k = 0; k < 3; ++k) {
        const glm::vec2 p(t.position[k]);
        EXPECT_LT(glm::length(t.texCoord[k] - 0.5f - p), 0x1p-15f);
        EXPECT_LT(glm::length(t.secondTexCoord[k] - scale * glm::vec2(p.y, p.x)), 0x1p-15f * scale);
      }
    });
  }
}

TEST(HccMesh, VerticesThatDifferInTheSecondSetAloneStayApart) {
  Soup s = fromPoints({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 0, 0}, {1, 1, 0}, {0, 1, 0}});
  s.texCoords.assign(6, glm::vec2(0.5f));
  for (int i = 0; i < 6; ++i) s.secondTexCoords.push_back(glm::vec2(i < 3 ? 0.0f : 1.0f));
  std::set<float> seen;
  forEachTriangle(build(s), [&](std::uint32_t, const Triangle& t) {
    EXPECT_EQ(t.secondTexCoord[0], t.secondTexCoord[1]);
    EXPECT_EQ(t.secondTexCoord[0], t.secondTexCoord[2]);
    seen.insert(t.secondTexCoord[0].x);
  });
  EXPECT_EQ(seen, (std::set<float>{0.0f, 1.0f}));
}

TEST(HccMesh, RefusesASecondSetWithoutAFirst) {
  Soup s = withSecondSet(sheet(2), 1.0f);
  EXPECT_THROW(build(s), std::invalid_argument);
  s.texCoords.assign(s.positions.size(), glm::vec2(0.0f));
  s.secondTexCoords.pop_back();
  EXPECT_THROW(build(s), std::invalid_argument);
}

TEST(HccMesh, StoresOnlyWhatThePartHas) {
  Soup s = sheet(20);
  Sizes z = build(s).sizes();
  EXPECT_EQ(z.normals + z.texCoords + z.colors, 0u);
  EXPECT_EQ(z.total(), build(s).bytes().size());
  s.normals.assign(s.positions.size(), glm::vec3(0.0f, 0.0f, 1.0f));
  z = build(s).sizes();
  EXPECT_GT(z.normals, 0u);
  EXPECT_EQ(z.total(), build(s).bytes().size());
  const Triangle t = build(s).triangle(0, 0);
  EXPECT_TRUE(t.hasNormals && !t.hasTexCoords && !t.hasColors);
  EXPECT_EQ(t.color[1], glm::vec4(1.0f));
}

TEST(HccMesh, ConnectedMeshesTakeSevenBytesATriangle) {
  const Mesh mesh = build(sheet(300));
  const auto bytes = double(mesh.bytes().size() + mesh.topLevelBytes());
  EXPECT_LT(bytes / double(mesh.triangleCount()), 7.4);
}

TEST(HccMesh, TinyMeshes) {
  EXPECT_EQ(Mesh::build({}).triangleCount(), 0u);
  EXPECT_EQ(build(Soup()).clusterCount(), 0u);
  const Mesh one = build(fromPoints({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(one.triangleCount(), 1u);
  const Mesh point = build(fromPoints({{3, 3, 3}, {3, 3, 3}, {3, 3, 3}}));
  EXPECT_EQ(point.triangleCount(), 0u);
  EXPECT_EQ(point.droppedTriangles(), 1u);
  const Mesh line = build(fromPoints({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}}));
  EXPECT_EQ(line.triangleCount(), 1u) << "a line has three corners: dropping it could open a mesh";
  const Mesh needle = build(fromPoints({{0, 0, 0}, {1e6f, 0, 0}, {1e6f, 1e-3f, 0}}));
  EXPECT_EQ(needle.triangleCount() + needle.droppedTriangles(), 1u);
  for (const Mesh* m : {&one, &point, &line, &needle})
    EXPECT_NO_THROW(Mesh::fromBytes({m->bytes().begin(), m->bytes().end()}));
}

/// Their corners come from another place then.
TEST(HccMesh, AnExpandedMeshHasTheSameTriangles) {
  const Soup soup = withSecondSet(randomSoup(900, 3.0f, 5), 2.0f);
  const Mesh mesh = build(soup);
  Mesh expanded = build(soup);
  expanded.expand();
  std::uint64_t count = 0;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c)
    forEachTriangle(mesh, c, [&](std::uint32_t i) {
      const Triangle a = mesh.triangle(c, i), b = expanded.triangle(c, i);
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(a.position[k], b.position[k]);
        EXPECT_EQ(a.normal[k], b.normal[k]);
        EXPECT_EQ(a.texCoord[k], b.texCoord[k]);
        EXPECT_EQ(a.secondTexCoord[k], b.secondTexCoord[k]);
        EXPECT_EQ(a.color[k], b.color[k]);
      }
      ++count;
    });
  EXPECT_EQ(count, mesh.triangleCount());
}

TEST(HccMesh, AllInOnePlaneAndManyInOnePlace) {
  Soup plane = sheet(40);
  for (glm::vec3& p : plane.positions) p.z = 7.0f;
  const Mesh flat = build(plane);
  EXPECT_EQ(flat.triangleCount(), 3200u);
  std::vector<glm::vec3> same;
  for (int i = 0; i < 5000; ++i) same.insert(same.end(), {{0, 0, 0}, {1, 0, 0}, {0, 1, 1}});
  const Mesh stacked = build(fromPoints(same));
  EXPECT_EQ(stacked.triangleCount(), 5000u);
  EXPECT_NO_THROW(Mesh::fromBytes({stacked.bytes().begin(), stacked.bytes().end()}));
}

TEST(HccMesh, NonFiniteCornersAreDroppedAndCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN(),
              inf = std::numeric_limits<float>::infinity();
  Soup s = fromPoints({{0, 0, 0},
                       {1, 0, 0},
                       {0, 1, 0},
                       {nan, 0, 0},
                       {1, 0, 0},
                       {0, 1, 0},
                       {0, 0, 0},
                       {inf, 0, 0},
                       {0, 1, 0}});
  const Mesh mesh = build(s);
  EXPECT_EQ(mesh.triangleCount(), 1u);
  EXPECT_EQ(mesh.droppedTriangles(), 2u);
  EXPECT_LT(mesh.errorBound(), 1e-6);
  s.normals.assign(s.positions.size(), glm::vec3(nan));
  EXPECT_LT(glm::length(build(s).triangle(0, 0).normal[0] - glm::vec3(0, 0, 1)), 1e-4f)
      << "a useless normal becomes the face's";
}

TEST(HccMesh, RefusesWhatItCannotBuild) {
  Soup s = fromPoints({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  s.triangles[0].z = 3;
  EXPECT_THROW(build(s), std::invalid_argument);
  s.triangles[0].z = 2;
  s.normals.resize(2);
  EXPECT_THROW(build(s), std::invalid_argument);
  s.normals.clear();
  BuildOptions options;
  options.precisionBits = 25;
  EXPECT_THROW(build(s, options), std::invalid_argument);
  EXPECT_THROW(build(fromPoints({{-3e38f, 0, 0}, {3e38f, 0, 0}, {0, 1, 0}})),
               std::invalid_argument);
}

TEST(HccMesh, PartsKeepMaterialAndObjectAndMirrorsKeepTheFront) {
  const Soup s = sheet(6);
  Part a = s.part(), b = s.part();
  a.material = 3, a.object = 9;
  b.material = 4, b.object = 8;
  b.transform[0][0] = -1.0;
  b.transform[3] = glm::dvec4(0.0, 0.0, 5.0, 1.0);
  const Part parts[2] = {a, b};
  const Mesh mesh = Mesh::build(parts);
  std::map<std::pair<unsigned, unsigned>, int> count;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c)
    EXPECT_EQ(mesh.clusterMaterial(c) == 3 ? 9u : 8u, mesh.clusterObject(c));
  forEachTriangle(mesh, [&](std::uint32_t, const Triangle& t) {
    ++count[{t.material, t.object}];
    EXPECT_GT(glm::cross(t.position[1] - t.position[0], t.position[2] - t.position[0]).z, 0.0f);
  });
  EXPECT_EQ(count.size(), 2u);
  EXPECT_EQ((count[{3, 9}]), 72);
}

TEST(HccMesh, EqualBytesForAnyNumberOfThreads) {
  const Soup soup = randomSoup(20000, 1.0f, 5), connected = sheet(300);
  Part parts[2] = {soup.part(), connected.part()};
  parts[1].material = 1;
  std::vector<std::vector<std::byte>> results;
  for (std::size_t threads : {1u, 2u, 5u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Mesh mesh = Mesh::build(parts);
    results.emplace_back(mesh.bytes().begin(), mesh.bytes().end());
  }
  EXPECT_EQ(results[0], results[1]);
  EXPECT_EQ(results[0], results[2]);
}

TEST(HccMesh, SharedVerticesHaveEqualCoordinatesInEveryCluster) {
  const Soup s = sheet(100);
  const Mesh mesh = build(s);
  ASSERT_GT(mesh.clusterCount(), 60u);
  std::map<std::array<float, 3>, int> uses;
  forEachTriangle(mesh, [&](std::uint32_t, const Triangle& t) {
    for (const glm::vec3& p : t.position) ++uses[{p.x, p.y, p.z}];
  });
  EXPECT_EQ(uses.size(), s.positions.size());
}
