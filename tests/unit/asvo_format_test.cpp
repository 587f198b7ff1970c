// The file of a tree: round trip, hostile bytes.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "asvo/tracer.h"
#include "tests/unit/asvo_shapes.h"

namespace {

using asvo::FormatError;
using asvo::Tree;
using asvo_shapes::Random;
using asvo_shapes::Shape;

Tree smallTree() {
  Shape shape;
  shape.constant.emission = asvo::vec3(1.0f);
  shape.addBox({-1, -1, -1}, {1, 1, 1}, asvo_shapes::rotationOf(20.0f, {1, 2, 3}));
  asvo::BuildOptions options;
  options.depth = 3;
  Tree tree = Tree::build(shape, options);
  tree.sourceHash = 0x123456789abcdefull;
  return tree;
}

/// Puts right the header's checksum, so that the checks behind it are reached.
void sign(std::vector<std::byte>& bytes) {
  const std::uint64_t hash = XXH3_64bits(bytes.data(), 136);
  std::memcpy(bytes.data() + 136, &hash, 8);
}

void expectEqual(const Tree& a, const Tree& b) {
  EXPECT_EQ(0, std::memcmp(&a.info, &b.info, sizeof(a.info)));
  EXPECT_EQ(a.nodes, b.nodes);
  EXPECT_EQ(a.voxels, b.voxels);
  EXPECT_EQ(a.leaves, b.leaves);
  EXPECT_EQ(a.emitters, b.emitters);
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

// Reads the whole file by the text of FORMAT.md alone.
TEST(AsvoFormat, LayoutIsAsDescribed) {
  asvo_shapes::Shape shape = asvo_shapes::cornellBox();
  shape.constant.emission = asvo::vec3(1.0f, 2.0f, 0.5f);
  const Tree tree = Tree::build(shape, {.depth = 4});
  const asvo::Tracer tracer(tree);
  const auto bytes = tree.toBytes();
  auto at = [&]<typename T>(std::size_t offset, T value) {
    std::memcpy(&value, bytes.data() + offset, sizeof(value));
    return value;
  };
  EXPECT_EQ(0, std::memcmp(bytes.data(), "ASVOtree", 8));
  EXPECT_EQ(3u, at(8, 0u));
  EXPECT_EQ(bytes.size(), at(16, std::uint64_t{}));
  EXPECT_EQ(4u, at(48, 0u));
  const auto nodeCount = at(52, 0u), firstLeaf = at(56, 0u), leafCount = at(60, 0u);
  EXPECT_EQ(nodeCount, firstLeaf + leafCount);
  const auto nodes = at(64, std::uint64_t{}), voxels = at(80, std::uint64_t{});
  const auto leaves = at(96, std::uint64_t{}), emitters = at(112, std::uint64_t{});
  EXPECT_EQ(4096u, nodes);
  std::uint32_t next = 1;
  for (std::uint32_t i = 0; i < nodeCount; ++i) {
    if (i < firstLeaf) {
      EXPECT_EQ(next, at(nodes + 8ull * i, 0u));
      next += static_cast<std::uint32_t>(std::popcount(at(nodes + 8ull * i + 4, 0u)));
    } else {
      EXPECT_NE(0u, at(leaves + 8ull * (i - firstLeaf), std::uint64_t{}));
    }
    const std::size_t voxel = voxels + 16ull * i;
    const std::uint32_t x = at(voxel, 0u), y = at(voxel + 4, 0u);
    const std::uint32_t z = at(voxel + 8, 0u), w = at(voxel + 12, 0u);
    const std::uint32_t covered[6] = {x & 63,       x >> 6 & 63,  x >> 12 & 63,
                                      x >> 18 & 63, x >> 24 & 63, y & 63};
    for (std::uint32_t d = 0; d < 6; ++d) {
      EXPECT_EQ(covered[d], tracer.asvoCoverage(tree.voxels[i], d));
    }
    // Octahedral: the sheet folded back over the lower half.
    double u = (y >> 6 & 8191) / 4095.5 - 1.0, v = (y >> 19) / 4095.5 - 1.0;
    const double up = 1.0 - std::abs(u) - std::abs(v);
    if (up < 0.0) {
      const double s = (1.0 - std::abs(v)) * (u < 0.0 ? -1.0 : 1.0);
      v = (1.0 - std::abs(u)) * (v < 0.0 ? -1.0 : 1.0);
      u = s;
    }
    const glm::dvec3 normal = glm::normalize(glm::dvec3(u, v, up));
    EXPECT_LT(glm::length(normal - glm::dvec3(tracer.asvoNormal(i))), 1e-6);
    EXPECT_NEAR((z & 255) / 255.0, static_cast<double>(tracer.asvoAlbedo(i).x), 1e-6);
    EXPECT_EQ(z >> 24 != 0, tracer.asvoHasPlane(i));
    EXPECT_EQ(w & 65535, tracer.asvoMaterial(i));
    const double area =
        w >> 16 == 0 ? 0.0 : std::ldexp(2048.0 + (w >> 16 & 2047), static_cast<int>(w >> 27) - 32);
    EXPECT_EQ(area, static_cast<double>(tracer.asvoArea(i)));
  }
  EXPECT_EQ(nodeCount, next);
  const auto emitterCount = at(128, 0u);
  EXPECT_EQ(nodeCount, emitterCount);  // all shines
  for (std::uint32_t k = 0; k < emitterCount; ++k) {
    EXPECT_EQ(k, at(emitters + 12ull * k, 0u));
    const std::uint32_t front = at(emitters + 12ull * k + 4, 0u);
    const double green = std::ldexp(front >> 9 & 511, static_cast<int>(front >> 27) - 24);
    EXPECT_EQ(green, static_cast<double>(tree.emission(k, true).y));
  }
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
    const auto at = static_cast<std::size_t>(random.uniform() * 136.0f);
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
  expectBad([](Tree& t) { t.emitters.push_back({t.info.nodeCount, 1u, 0u}); });
  expectBad([](Tree& t) { t.emitters.push_back({0u, 0u, 0u}); });
  expectBad([](Tree& t) { t.emitters.insert(t.emitters.end(), {{2u, 1u, 0u}, {2u, 1u, 0u}}); });
  expectBad([](Tree& t) { t.leaves.pop_back(); });
  expectBad([](Tree& t) { t.info.size = -1.0f; });
  expectBad([](Tree& t) { t.info.depth = 13; });
}

}  // namespace
