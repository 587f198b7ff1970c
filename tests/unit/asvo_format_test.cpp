// The file of a tree: round trip, hostile bytes.
#include <gtest/gtest.h>

#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "tests/unit/asvo_shapes.h"

namespace {

using asvo::FormatError;
using asvo::Tree;
using asvo_shapes::Random;
using asvo_shapes::Shape;

Tree smallTree() {
  Shape shape;
  shape.addBox({-1, -1, -1}, {1, 1, 1}, asvo_shapes::rotationOf(20.0f, {1, 2, 3}));
  asvo::BuildOptions options;
  options.depth = 3;
  Tree tree = Tree::build(shape, options);
  tree.sourceHash = 0x123456789abcdefull;
  return tree;
}

/// Puts right the header's checksum, so that the checks behind it are reached.
void sign(std::vector<std::byte>& bytes) {
  const std::uint64_t hash = XXH3_64bits(bytes.data(), 120);
  std::memcpy(bytes.data() + 120, &hash, 8);
}

void expectEqual(const Tree& a, const Tree& b) {
  EXPECT_EQ(0, std::memcmp(&a.info, &b.info, sizeof(a.info)));
  EXPECT_EQ(a.nodes, b.nodes);
  EXPECT_EQ(a.voxels, b.voxels);
  EXPECT_EQ(a.leaves, b.leaves);
  EXPECT_EQ(a.levelOffsets, b.levelOffsets);
  EXPECT_EQ(a.sourceHash, b.sourceHash);
}

TEST(AsvoFormat, RoundTrip) {
  const Tree tree = smallTree();
  const auto bytes = tree.toBytes();
  const Tree again = Tree::fromBytes(bytes);
  expectEqual(tree, again);
  EXPECT_EQ(bytes, again.toBytes());
}

TEST(AsvoFormat, RoundTripOfAnEmptyTree) {
  const Tree tree = Tree::build(Shape{});
  expectEqual(tree, Tree::fromBytes(tree.toBytes()));
}

// Reads the file by the text of FORMAT.md alone.
TEST(AsvoFormat, LayoutIsAsDescribed) {
  const Tree tree = smallTree();
  const auto bytes = tree.toBytes();
  auto at = [&]<typename T>(std::size_t offset, T value) {
    std::memcpy(&value, bytes.data() + offset, sizeof(value));
    return value;
  };
  EXPECT_EQ(0, std::memcmp(bytes.data(), "ASVOtree", 8));
  EXPECT_EQ(1u, at(8, 0u));
  EXPECT_EQ(bytes.size(), at(16, std::uint64_t{}));
  EXPECT_EQ(3u, at(48, 0u));
  const auto nodeCount = at(52, 0u), firstLeaf = at(56, 0u), leafCount = at(60, 0u);
  EXPECT_EQ(nodeCount, firstLeaf + leafCount);
  const auto nodes = at(64, std::uint64_t{}), leaves = at(96, std::uint64_t{});
  EXPECT_EQ(4096u, nodes);
  // From the root down the first children: the last is a leaf whose mask is not empty.
  std::uint32_t node = 0;
  for (int level = 0; level < 3; ++level) node = at(nodes + 8ull * node, 0u);
  EXPECT_EQ(firstLeaf, node);
  EXPECT_NE(0u, at(leaves, std::uint64_t{}));
}

TEST(AsvoFormat, EveryFlippedBitIsNoticed) {
  const auto bytes = smallTree().toBytes();
  Random random(5);
  for (std::size_t i = 0; i < bytes.size(); i += i < 200 ? 1 : 37) {
    auto flipped = bytes;
    flipped[i] ^= std::byte(1u << static_cast<unsigned>(random.uniform() * 8.0f));
    EXPECT_THROW(Tree::fromBytes(flipped), FormatError) << "byte " << i;
  }
}

TEST(AsvoFormat, TruncatedAndExtendedFilesAreRefused) {
  const auto bytes = smallTree().toBytes();
  for (std::size_t size = 0; size < bytes.size(); size += size < 300 ? 1 : 911) {
    EXPECT_THROW(Tree::fromBytes({bytes.data(), size}), FormatError) << size;
  }
  auto longer = bytes;
  longer.resize(bytes.size() + 4096);
  EXPECT_THROW(Tree::fromBytes(longer), FormatError);
}

TEST(AsvoFormat, SignedButHostileHeadersAreRefused) {
  const auto bytes = smallTree().toBytes();
  Random random(6);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    auto hostile = bytes;
    const auto at = static_cast<std::size_t>(random.uniform() * 120.0f);
    const std::uint32_t value =
        i % 3 == 0 ? 0xffffffffu : static_cast<std::uint32_t>(i * 2654435761u);
    std::memcpy(hostile.data() + at / 4 * 4, &value, 4);
    sign(hostile);
    // The source hash and the place of the cube are the caller's: any value goes.
    try {
      const Tree tree = Tree::fromBytes(hostile);
      EXPECT_EQ(smallTree().nodes.size(), tree.nodes.size());
    } catch (const FormatError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 2000);
}

TEST(AsvoFormat, ValidateFindsWrongArrays) {
  const Tree good = smallTree();
  asvo::validate(good);
  auto expectBad = [&](auto change) {
    Tree tree = good;
    change(tree);
    EXPECT_THROW(asvo::validate(tree), FormatError);
  };
  expectBad([](Tree& t) { t.nodes[0].x = 7; });
  expectBad([](Tree& t) { t.nodes[1].y = 256; });
  expectBad([](Tree& t) { t.nodes[1].y = 0; });
  expectBad([](Tree& t) { t.nodes.back().y = 1; });
  expectBad([](Tree& t) { t.leaves[0].x = t.leaves[0].y = 0; });
  expectBad([](Tree& t) { t.leaves[0].w = 0x7f800000u; });
  expectBad([](Tree& t) { t.voxels[1].z = 0x7fc00000u; });
  expectBad([](Tree& t) { t.leaves.pop_back(); });
  expectBad([](Tree& t) { t.info.size = -1.0f; });
  expectBad([](Tree& t) { t.info.depth = 13; });
}

}  // namespace
