// FORMAT.md: a second decoder reads the same mesh, and no damage goes unnoticed.
#include <gtest/gtest.h>
#include <xxhash.h>

#include <random>

#include "hccmesh_meshes.h"
#include "hccmesh_naive.h"

using namespace hccm;
using namespace hccm::test;

namespace {

std::vector<std::byte> bytesOf(const Mesh& m) { return {m.bytes().begin(), m.bytes().end()}; }

// Makes the checksum right again, so that only the structure is at fault.
void sign(std::vector<std::byte>& b) {
  std::fill_n(b.begin() + 16, 8, std::byte{0});
  const std::uint64_t sum = XXH3_64bits(b.data(), b.size());
  std::memcpy(b.data() + 16, &sum, 8);
}

void expectEqual(const Mesh& mesh, const naive::File& file) {
  ASSERT_EQ(file.clusters.size(), mesh.clusterCount());
  EXPECT_EQ(file.step, mesh.step());
  EXPECT_EQ(file.triangles, mesh.triangleCount());
  EXPECT_EQ(file.dropped, mesh.droppedTriangles());
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
    const naive::Cluster& n = file.clusters[c];
    ASSERT_EQ(n.corners.size(), 3u * mesh.clusterTriangleCount(c));
    ASSERT_EQ(n.leaves.size(), mesh.clusterLeafCount(c));
    EXPECT_EQ(n.material, mesh.clusterMaterial(c));
    std::vector<std::uint32_t> numbers;
    forEachTriangle(mesh, c, [&](std::uint32_t number) { numbers.push_back(number); });
    ASSERT_EQ(3u * numbers.size(), n.corners.size());
    for (std::uint32_t i = 0; i < n.corners.size(); ++i) {
      const Triangle t = mesh.triangle(c, numbers[i / 3]);
      const naive::Vertex& v = n.vertices.at(n.corners[i]);
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(double(t.position[i % 3][k]), double(v.grid[k]) * file.step);
        EXPECT_NEAR(double(t.normal[i % 3][k]), v.normal[k], 1e-6);
      }
      for (int k = 0; k < 2; ++k)
        EXPECT_NEAR(double(t.texCoord[i % 3][k]), v.uv[k], 1e-6 * (1.0 + std::abs(v.uv[k])));
      for (int k = 0; k < 2; ++k)
        EXPECT_NEAR(double(t.secondTexCoord[i % 3][k]), v.secondUv[k],
                    1e-6 * (1.0 + std::abs(v.secondUv[k])));
      for (int k = 0; k < 4; ++k)
        EXPECT_NEAR(double(t.color[i % 3][k]), t.hasColors ? v.color[k] : 1.0, 1e-6);
    }
    glm::vec3 lower, upper;
    mesh.clusterBounds(c, lower, upper);
    for (const naive::Vertex& v : n.vertices)
      for (int k = 0; k < 3; ++k) {
        EXPECT_LE(double(lower[k]), double(v.grid[k]) * file.step);
        EXPECT_GE(double(upper[k]), double(v.grid[k]) * file.step);
      }
    if (n.leaves.size() > 1)
      for (const naive::Leaf& leaf : n.leaves)
        for (std::uint32_t i = 3 * leaf.first; i < 3 * leaf.end; ++i)
          for (int k = 0; k < 3; ++k) {
            EXPECT_LE(leaf.lower[k], n.vertices[n.corners[i]].grid[k]);
            EXPECT_GE(leaf.upper[k], n.vertices[n.corners[i]].grid[k]);
          }
  }
}

Mesh smallMesh(bool secondSet = false) {
  Soup s = sheet(3);
  for (const glm::vec3& p : s.positions) {
    s.normals.push_back(glm::normalize(p + glm::vec3(0.0f, 0.0f, 1.0f)));
    s.texCoords.push_back(glm::vec2(p));
    s.colors.push_back(glm::u8vec4(1, 2, 3, 4));
  }
  return build(secondSet ? withSecondSet(s, 1.0f) : s);
}

// Traces and decodes everything: sanitizers watch.
void useAll(const Mesh& mesh) {
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
    forEachTriangle(mesh, c, [&](std::uint32_t t) { mesh.triangle(c, t); });
    PreparedRay ray =
        mesh.prepare({glm::vec3(0.01f, 0.02f, 9.0f), 0.0f, glm::vec3(0, 0, -1), 1e30f});
    Hit hit;
    mesh.intersect(c, ray, hit);
    mesh.occluded(c, ray);
  }
  mesh.sizes();
}

}  // namespace

TEST(HccMeshFormat, NaiveDecoderReadsTheSame) {
  const Mesh soup = build(randomSoup(1500, 3.0f, 11)), connected = build(sheet(40));
  expectEqual(soup, naive::readFile(soup.bytes()));
  expectEqual(connected, naive::readFile(connected.bytes()));
  const Mesh wide = build(randomSoup(40, 1e4f, 12));
  expectEqual(wide, naive::readFile(wide.bytes()));
  for (const float scale : {1.0f, 1e3f}) {
    const Mesh twoSets = build(withSecondSet(randomSoup(1500, 3.0f, 16), scale));
    expectEqual(twoSets, naive::readFile(twoSets.bytes()));
  }
}

TEST(HccMeshFormat, HeaderOfVersionTwo) {
  const std::vector<std::byte> b = bytesOf(smallMesh());
  EXPECT_EQ(std::memcmp(b.data(), "HCCM\2\0\0\0", 8), 0);
  const naive::Reader r(b);
  EXPECT_EQ(r.u64(8), b.size());
  EXPECT_EQ(r.u64(56), 18u);
  EXPECT_EQ(r.u32(112) * 16u, (112u + 4u * r.u32(76) + 15u) / 16u * 16u);
}

TEST(HccMeshFormat, FromBytesGivesTheSameMesh) {
  const Mesh mesh = build(randomSoup(500, 1.0f, 13));
  EXPECT_EQ(bytesOf(Mesh::fromBytes(bytesOf(mesh))), bytesOf(mesh));
}

TEST(HccMeshFormat, EveryFlippedBitIsNoticed) {
  std::vector<std::byte> b = bytesOf(smallMesh(true));
  for (std::size_t bit = 0; bit < 8 * b.size(); ++bit) {
    const std::byte mask{static_cast<unsigned char>(1u << (bit % 8))};
    b[bit / 8] ^= mask;
    EXPECT_THROW(Mesh::fromBytes(b), FormatError) << "bit " << bit;
    b[bit / 8] ^= mask;
  }
  EXPECT_NO_THROW(Mesh::fromBytes(b));
}

TEST(HccMeshFormat, TruncatedAndExtendedBuffersAreRefused) {
  const std::vector<std::byte> b = bytesOf(smallMesh());
  for (std::size_t size = 0; size < b.size(); ++size) {
    EXPECT_THROW(Mesh::fromBytes({b.begin(), b.begin() + std::ptrdiff_t(size)}), FormatError)
        << size;
    if (size < 112) continue;
    std::vector<std::byte> cut(b.begin(), b.begin() + std::ptrdiff_t(size));
    const std::uint64_t claimed = size;
    std::memcpy(cut.data() + 8, &claimed, 8);
    sign(cut);
    EXPECT_THROW(Mesh::fromBytes(cut), FormatError) << size;
  }
  std::vector<std::byte> longer = b;
  longer.resize(b.size() + 4);
  EXPECT_THROW(Mesh::fromBytes(longer), FormatError);
  const std::uint64_t claimed = longer.size();
  std::memcpy(longer.data() + 8, &claimed, 8);
  sign(longer);
  EXPECT_THROW(Mesh::fromBytes(longer), FormatError);
}

TEST(HccMeshFormat, DamageWithARightChecksumIsRefusedOrHarmless) {
  const std::vector<std::byte> good =
      bytesOf(build(withSecondSet(randomSoup(150, 1.0f, 14), 1.0f)));
  std::mt19937 random(15);
  int accepted = 0, refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::byte> b = good;
    for (unsigned k = 0; k <= random() % 3; ++k)
      b[(random() % 4 ? random() : random() % 400) % b.size()] = static_cast<std::byte>(random());
    sign(b);
    try {
      useAll(Mesh::fromBytes(b));
      ++accepted;
    } catch (const FormatError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 5000);
  EXPECT_GT(accepted, 0) << "attributes may take any value";
}

void expectFieldsChecked(const std::vector<std::byte>& good, const std::vector<int>& wrongFlags) {
  const std::size_t cluster = 16u * naive::Reader(good).u32(112);
  const auto refused = [&](std::size_t at, int value) {
    std::vector<std::byte> b = good;
    ASSERT_NE(b[at], static_cast<std::byte>(value)) << "byte " << at;
    b[at] = static_cast<std::byte>(value);
    sign(b);
    EXPECT_THROW(Mesh::fromBytes(b), FormatError) << "byte " << at;
  };
  refused(4, 1);     // version
  refused(76, 255);  // clusters
  refused(79, 255);
  refused(104, 1);   // reserved
  refused(75, 127);  // step
  refused(112, 0);   // table into the header
  refused(116, 1);   // padding of the table
  refused(cluster + 20, 255);
  refused(cluster + 21, 255);
  refused(cluster + 22, 0);
  refused(cluster + 22, 65);
  for (const int flags : wrongFlags) refused(cluster + 23, flags);
  refused(cluster + 24, 26);
  refused(cluster + 27, 31);
  refused(cluster + 30, 1);
  refused(cluster + 33, 1);
  refused(cluster + 34, 0);
  refused(good.size() - 1, 1);
}

TEST(HccMeshFormat, FieldsOutOfRangeAreRefused) {
  // A second set without a first one, floats without the set, unknown ones, a set that is not
  // there.
  expectFieldsChecked(bytesOf(smallMesh()), {16, 25, 43, 64, 75, 139, 27});
  expectFieldsChecked(bytesOf(smallMesh(true)), {25, 91, 155, 11, 59});
}
