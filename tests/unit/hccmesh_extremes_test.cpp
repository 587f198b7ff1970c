// Meshes at the ends of what there can be.
#include <gtest/gtest.h>
#include <sys/mman.h>

#include <cmath>
#include <limits>

#include "hccmesh/layout.h"
#include "hccmesh/trace.h"
#include "hccmesh_meshes.h"

using namespace hccm;
using namespace hccm::test;

namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();

bool hits(const Mesh& mesh, const glm::vec3& from, const glm::vec3& to, Hit& hit) {
  const Ray ray{from, 0.0f, to - from, kInf};
  PreparedRay prepared = mesh.prepare(ray);
  const bool found = mesh.intersect(prepared, hit);
  EXPECT_EQ(found, mesh.occluded(mesh.prepare(ray)));
  return found;
}
bool hits(const Mesh& mesh, const glm::vec3& from, const glm::vec3& to) {
  Hit hit;
  return hits(mesh, from, to, hit);
}

void expectValid(const Mesh& mesh) {
  EXPECT_NO_THROW(Mesh::fromBytes({mesh.bytes().begin(), mesh.bytes().end()}));
}

}  // namespace

TEST(HccMeshExtremes, NoTriangleAndOne) {
  const Mesh none = build(Soup());
  EXPECT_FALSE(hits(none, {0, 0, 1}, {0, 0, 0}));
  Soup s;
  s.positions = {{-1, -1, 0}, {1, -1, 0}, {0, 1, 0}};
  s.triangles = {{0, 1, 2}};
  const Mesh one = build(s);
  expectValid(one);
  EXPECT_TRUE(hits(one, {0, 0, 1}, {0, 0, 0}));
  EXPECT_FALSE(hits(one, {0, 3, 1}, {0, 3, 0}));
}

TEST(HccMeshExtremes, AllInOnePoint) {
  Soup s;
  s.positions.assign(300, glm::vec3(4.0f, 5.0f, 6.0f));
  for (std::uint32_t i = 0; i + 2 < 300; ++i) s.triangles.push_back({i, i + 1, i + 2});
  const Mesh mesh = build(s);
  expectValid(mesh);
  EXPECT_EQ(mesh.triangleCount(), 0u);
  EXPECT_EQ(mesh.droppedTriangles(), 298u);
  EXPECT_FALSE(hits(mesh, {0, 0, 1}, {0, 0, 0}));
}

TEST(HccMeshExtremes, AllInOnePlaneOfAnyAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    Soup s = sheet(40);
    for (glm::vec3& p : s.positions) {
      const glm::vec3 flat(p.x, p.y, 0.0f);
      for (int k = 0; k < 3; ++k) p[(axis + 1 + k) % 3] = flat[k];
    }
    const Mesh mesh = build(s);
    expectValid(mesh);
    glm::vec3 from(0.013f), to(0.013f);
    from[axis] = 1.0f, to[axis] = 0.0f;
    Hit hit;
    EXPECT_TRUE(hits(mesh, from, to, hit)) << axis;
    EXPECT_NEAR(hit.t, 1.0f, 1e-5f);
    glm::vec3 along = from;
    along[(axis + 1) % 3] += 1.0f;  // parallel to the plane, above it
    EXPECT_FALSE(hits(mesh, from, along));
  }
}

TEST(HccMeshExtremes, ExtentsFromAMicrometreToTenThousandKilometres) {
  for (float extent : {1e-6f, 1e-3f, 1.0f, 1e4f, 1e7f}) {
    const Mesh mesh = build(sheet(60, extent));
    expectValid(mesh);
    EXPECT_LT(mesh.errorBound(), 1.5e-7 * double(extent));
    for (float x : {-0.31f, 0.0f, 0.27f})
      for (float height : {0.5f, 50.0f}) {
        Hit hit;
        const glm::vec3 from(x * extent, 0.11f * extent, height * extent);
        ASSERT_TRUE(hits(mesh, from, from - glm::vec3(0, 0, extent), hit)) << extent;
        EXPECT_NEAR(hit.t, height, 0.2f);
      }
  }
}

// Two sheets of needles, a million times as long as wide, that share their edges.
TEST(HccMeshExtremes, NeedlesOfAMillionToOne) {
  Soup s;
  constexpr std::uint32_t kCount = 2000;
  constexpr float kWidth = 1e-3f;
  for (std::uint32_t i = 0; i <= kCount; ++i)
    for (float x : {-500.0f, 500.0f})
      s.positions.push_back({x, kWidth * (float(i) - 0.5f * float(kCount)), 0.0f});
  for (std::uint32_t i = 0; i < kCount; ++i) {
    s.triangles.push_back({2 * i, 2 * i + 1, 2 * i + 3});
    s.triangles.push_back({2 * i, 2 * i + 3, 2 * i + 2});
  }
  const Mesh mesh = build(s);
  expectValid(mesh);
  EXPECT_EQ(mesh.triangleCount(), 2 * kCount);
  std::mt19937 random(51);
  for (int i = 0; i < 2000; ++i) {
    const glm::vec3 target =
        randomPoint(random, 1.0f) * glm::vec3(499.0f, 0.49f * kWidth * float(kCount), 0);
    const glm::vec3 from = target + glm::vec3(randomPoint(random, 1.0f).x, 0.2f, 3.0f);
    EXPECT_TRUE(hits(mesh, from, target)) << i;
  }
}

TEST(HccMeshExtremes, TrianglesWithoutAreaDoNoHarm) {
  Soup s = sheet(20);
  const auto count = static_cast<std::uint32_t>(s.positions.size());
  for (std::uint32_t i = 0; i + 2 < count; i += 3) {  // lines and points among the others
    s.triangles.push_back({i, i + 1, i});
    s.triangles.push_back({i, i, i});
    s.positions.push_back((s.positions[i] + s.positions[i + 1]) * 0.5f);
    s.triangles.push_back({i, static_cast<std::uint32_t>(s.positions.size()) - 1, i + 1});
  }
  const Mesh mesh = build(s);
  expectValid(mesh);
  std::mt19937 random(52);
  for (int i = 0; i < 500; ++i) {
    const glm::vec3 target = randomPoint(random, 0.45f);
    EXPECT_TRUE(hits(mesh, {target.x, target.y, 2.0f}, {target.x, target.y, 0.0f}));
  }
}

TEST(HccMeshExtremes, RaysThatStartInsideBoxesAndRunAlongAxes) {
  const Mesh mesh = build(sheet(50));
  std::mt19937 random(53);
  for (int i = 0; i < 3000; ++i) {
    const glm::vec3 p = randomPoint(random, 0.45f);
    const float z = 0.1f * std::sin(9.0f * p.x) * std::cos(7.0f * p.y);
    const float up = i % 2 ? 1.0f : -1.0f;
    const glm::vec3 from(p.x, p.y, z + up * (i % 3 == 0 ? 1e-3f : 0.01f));
    const float tiny = i % 5 == 0 ? std::numeric_limits<float>::denorm_min() : 0.0f;
    const glm::vec3 origin = from - glm::vec3(mesh.gridOrigin());
    PreparedRay towards = mesh.prepare({origin, 0.0f, {tiny, -tiny, -up}, kInf});
    Hit hit;
    EXPECT_TRUE(mesh.intersect(towards, hit)) << i;
    EXPECT_LT(hit.t, 0.02f);
    EXPECT_FALSE(mesh.occluded(mesh.prepare({origin, 0.0f, {tiny, -tiny, up}, kInf}))) << i;
  }
}

// A blob beyond 2^32 words of 4 bytes, in address space that holds no memory.
TEST(HccMeshExtremes, BlobsLieAnywhereInSixtyFourGibibytes) {
  EXPECT_EQ(layout::blobOffset(0xffffffffu), (std::uint64_t{1} << 36) - 16);
  EXPECT_EQ(layout::firstBlob(std::uint64_t{1} << 33), 112u + (std::uint64_t{1} << 35));
  const Mesh mesh = build(sheet(10));
  ASSERT_EQ(mesh.clusterCount(), 1u);
  const std::uint64_t offset = std::uint64_t{40} << 30;
  void* space = mmap(nullptr, offset + (1u << 20), PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (space == MAP_FAILED) GTEST_SKIP() << "no address space";
  auto* bytes = static_cast<std::byte*>(space);
  const std::span<const std::byte> blob = mesh.clusterBytes(0);
  std::copy(blob.begin(), blob.end(), bytes + offset);
  const auto word = static_cast<std::uint32_t>(offset >> layout::kTableShift);
  layout::ClusterHeader h;
  std::memcpy(&h, blob.data(), sizeof(h));
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    box.lower[k] = h.lower[k];
    box.upper[k] = h.lower[k] + (std::int32_t(h.top[k]) << h.boxShift[k]);
  }
  const TopLevel top({&box, 1});
  PreparedRay ray = mesh.prepare({{0.01f, 0.02f, 1.0f}, 0.0f, {0, 0, -1}, kInf});
  Hit far, near;
  EXPECT_TRUE(chooseKernels()->intersectMesh({top.nodes().data(), bytes, &word}, ray, far));
  ray = mesh.prepare({{0.01f, 0.02f, 1.0f}, 0.0f, {0, 0, -1}, kInf});
  EXPECT_TRUE(mesh.intersect(ray, near));
  EXPECT_EQ(far.t, near.t);
  EXPECT_EQ(far.triangle, near.triangle);
  munmap(space, offset + (1u << 20));
}
