// Pages of clusters: lossless, small, and no damage leads anywhere but to an error.
#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <random>

#include "hccmesh/layout.h"
#include "hccmesh/pack.h"
#include "hccmesh/validate.h"
#include "hccmesh_meshes.h"
#include "tests/fuzz/plain_page.h"

using namespace hccm;
using namespace hccm::test;

namespace {

using Blobs = std::vector<std::span<const std::byte>>;

Blobs blobsOf(const Mesh& mesh) {
  Blobs blobs;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) blobs.push_back(mesh.clusterBytes(c));
  return blobs;
}

void expectSame(const Blobs& blobs, const ClusterPage& page) {
  ASSERT_EQ(page.count(), blobs.size());
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    ASSERT_EQ(page.offsets[i + 1] - page.offsets[i], blobs[i].size());
    EXPECT_TRUE(std::equal(blobs[i].begin(), blobs[i].end(), page.blob(i))) << i;
  }
}

}  // namespace

TEST(HccMeshPack, BlobsComeBackBitForBit) {
  Soup coloured = sheet(30);
  coloured.colors.assign(coloured.positions.size(), glm::u8vec4(9, 8, 7, 6));
  for (const Mesh& mesh : {build(sheet(60)), build(randomSoup(2000, 3.0f, 41)), build(coloured),
                           build(withSecondSet(randomSoup(2000, 3.0f, 42), 1.0f))}) {
    const Blobs blobs = blobsOf(mesh);
    const std::vector<std::byte> packed = packClusters(blobs);
    const ClusterPage page = unpackClusters(packed);
    EXPECT_EQ(unpackedBytes(packed), page.bytes.size());
    expectSame(blobs, page);
    EXPECT_EQ(packed, packClusters(blobs));
  }
}

TEST(HccMeshPack, EveryInstructionSetUnpacksTheSame) {
  // Small leaves, large ones, and vertices wider than a word.
  const Mesh meshes[] = {build(sheet(60)), build(randomSoup(2000, 3.0f, 44)),
                         build(randomSoup(300, 1e6f, 45))};
  for (std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    for (const Mesh& mesh : meshes)
      expectSame(blobsOf(mesh), unpackClusters(packClusters(blobsOf(mesh))));
  }
  hwy::SetSupportedTargetsForTest(0);
}

TEST(HccMeshPack, NoBlobsAreAPageToo) { EXPECT_EQ(unpackClusters(packClusters({})).count(), 0u); }

TEST(HccMeshPack, WiderBoxesThanNeededAreKept) {
  const Mesh mesh = build(sheet(20));
  std::vector<std::vector<std::byte>> wide;
  Blobs blobs;
  for (const std::span<const std::byte> blob : blobsOf(mesh)) {
    std::vector<std::byte>& copy = wide.emplace_back(blob.begin(), blob.end());
    copy[36] = std::byte{0};  // lower x of the first leaf
    copy.resize(blob.size() + layout::kTailBytes);
  }
  for (const auto& blob : wide)
    blobs.push_back(std::span<const std::byte>(blob).first(blob.size() - layout::kTailBytes));
  expectSame(blobs, unpackClusters(packClusters(blobs)));
}

TEST(HccMeshPack, TakesFiveBytesATriangleOfADenseMesh) {
  const Mesh mesh = build(sheet(500));
  EXPECT_LT(double(packedBytes(mesh)) / double(mesh.triangleCount()), 5.0);
  EXPECT_LT(packedBytes(mesh) * 10, mesh.bytes().size() * 8);
}

namespace {

/// Whether a page is taken. What is taken holds whole clusters.
bool isTaken(std::span<const std::byte> packed) {
  ClusterPage page;
  try {
    page = unpackClusters(packed);
  } catch (const FormatError&) {
    return false;
  }
  for (std::size_t i = 0; i < page.count(); ++i)
    EXPECT_NO_THROW(validateCluster({page.blob(i), page.offsets[i + 1] - page.offsets[i]}, 0));
  return true;
}

}  // namespace

TEST(HccMeshPack, DamagedPagesAreRefusedOrHoldOtherValidClusters) {
  const Mesh mesh = build(randomSoup(400, 1.0f, 42));
  const std::vector<std::byte> good = packClusters(blobsOf(mesh));
  std::mt19937 random(43);
  const auto damaged = [&](std::vector<std::byte> b) {
    for (unsigned k = 0; k <= random() % 3; ++k)
      b[(random() % 2 ? random() : random() % 600) % b.size()] = static_cast<std::byte>(random());
    return b;
  };
  int packed = 0, plain = 0;
  for (int i = 0; i < 20000; ++i) packed += !isTaken(damaged(good));
  EXPECT_GT(packed, 10000);
  // zstd notices nothing of these.
  const std::vector<std::byte> streams = trex::fuzz::plainPageOf(good);
  for (int i = 0; i < 4000; ++i) plain += !isTaken(trex::fuzz::packedPageOf(damaged(streams)));
  EXPECT_GT(plain, 400);
  EXPECT_LT(plain, 4000);
  for (std::size_t size = 0; size < good.size(); size += 7)
    EXPECT_THROW(unpackClusters({good.data(), size}), FormatError) << size;
  std::vector<std::byte> longer = good;
  longer.push_back(std::byte{0});
  EXPECT_THROW(unpackClusters(longer), FormatError);
}
