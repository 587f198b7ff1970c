// Voxels of triangles that are small against them: right values of many parts in a leaf, and masks
// against a plain separating axis test.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "asvo/tracer.h"
#include "tests/unit/asvo_shapes.h"

namespace {

using asvo::BuildOptions;
using asvo::Tracer;
using asvo::Tree;
using asvo_shapes::Random;
using asvo_shapes::Shape;
using glm::dvec3;
using glm::vec3;

/// Copies of one part, placed without being stored. Every second one is of the other material.
class Copies : public asvo::TriangleSource {
 public:
  Shape part;
  std::uint64_t copies = 0;
  vec3 lower{0.05f}, size{0.9f};  ///< the box that they are spread over evenly
  bool saysUniform = true;

  std::uint64_t count() const override { return copies * part.triangles.size(); }
  void get(std::uint64_t i, asvo::Triangle& triangle) const override {
    const std::uint64_t copy = i / part.triangles.size();
    triangle = part.triangles[i % part.triangles.size()];
    // The sequence R3 [Roberts 2018].
    const dvec3 at = glm::fract(dvec3(0.8191725134, 0.6710436067, 0.5497004779) * double(copy));
    for (vec3& p : triangle.position) p += lower + size * vec3(at);
    triangle.material = static_cast<std::uint32_t>(copy % 2);
  }
  asvo::Shade shade(const asvo::Triangle& triangle, float, float) const override {
    return {vec3(triangle.material == 0 ? 0.2f : 0.8f), vec3(0.0f), false};
  }
  bool uniform(const asvo::Triangle&) const override { return saysUniform; }
};

/// Four triangles over a square of edge 2 * half; the tip is `height` above it, along y.
Shape pyramid(float half, float height) {
  Shape shape;
  const vec3 tip(0.0f, height, 0.0f);
  const vec3 a(-half, 0, -half), b(-half, 0, half), c(half, 0, half), d(half, 0, -half);
  shape.add(a, b, tip);
  shape.add(b, c, tip);
  shape.add(c, d, tip);
  shape.add(d, a, tip);
  return shape;
}

BuildOptions unitCube(int depth) {
  BuildOptions options;
  options.depth = depth;
  options.size = 1.0f;
  return options;
}

void expectSameBits(const Tree& a, const Tree& b) {
  EXPECT_EQ(a.info.depth, b.info.depth);
  EXPECT_EQ(a.nodes, b.nodes);
  EXPECT_EQ(a.voxels, b.voxels);
  EXPECT_EQ(a.leaves, b.leaves);
  EXPECT_EQ(a.emitters, b.emitters);
}

// 10^5 pyramids, each smaller than a sub-voxel, about four in a leaf. Area, projected areas (the
// sums of normals) and albedo have closed forms. Values are dithered to their bits: the sum over n
// leaves is off by at most half a unit times sqrt(n) in deviation; five of these are allowed.
TEST(AsvoParts, ManySmallPartsKeepAreaNormalsAndAlbedo) {
  constexpr double kLeaf = 1.0 / 32.0, kHalf = 0.1 * kLeaf, kHeight = 0.05 * kLeaf;
  Copies source;
  source.copies = 100'000;
  source.part = pyramid(float(kHalf), float(kHeight));
  const Tree tree = Tree::build(source, unitCube(5));
  asvo::validate(tree);
  const Tracer tracer(tree);
  const auto copies = double(source.copies);
  double area = 0.0, albedo = 0.0, coverage[6] = {};
  for (std::uint32_t i = tree.info.firstLeaf; i < tree.info.nodeCount; ++i) {
    const auto own = double(tree.leafArea(i));
    area += own;
    albedo += own * double(tracer.asvoAlbedo(i).x);
    for (asvo::uint d = 0; d < 6; ++d) coverage[d] += tracer.asvoCoverage(tree.voxels[i], d) / 63.0;
  }
  const double expected = copies * 4.0 * kHalf * std::hypot(kHalf, kHeight);
  EXPECT_NEAR(1.0, area / expected, 1e-4);
  EXPECT_NEAR(0.5, albedo / area, 2e-4);
  const double slack = 5.0 * 0.5 / 63.0 * std::sqrt(double(tree.info.leafCount));
  const double side = copies * kHalf * kHeight / (kLeaf * kLeaf);
  const double top = copies * 4.0 * kHalf * kHalf / (kLeaf * kLeaf);
  const double right[6] = {side, side, top, 0.0, side, side};
  for (int d = 0; d < 6; ++d) EXPECT_NEAR(right[d], coverage[d], slack) << d;

  Copies asked = source;
  asked.saysUniform = false;
  expectSameBits(tree, Tree::build(asked, unitCube(5)));
}

TEST(AsvoParts, CrowdInOneSubVoxel) {
  constexpr double kLeaf = 1.0 / 32.0, kHalf = 1e-3 * kLeaf, kHeight = 0.5 * kHalf;
  Copies source;
  source.copies = 100'000;
  source.part = pyramid(float(kHalf), float(kHeight));
  source.lower = vec3(float(8.3 * kLeaf));
  source.size = vec3(float(0.1 * kLeaf));
  const Tree tree = Tree::build(source, unitCube(5));
  asvo::validate(tree);
  ASSERT_EQ(1u, tree.info.leafCount);
  EXPECT_EQ(1, std::popcount(tree.leaves[0].x) + std::popcount(tree.leaves[0].y));
  const std::uint32_t leaf = tree.info.firstLeaf;
  // Single precision beside coordinates of a quarter: 2^-26 of a half edge of 3e-5.
  const double area = double(source.copies) * 4.0 * kHalf * std::hypot(kHalf, kHeight);
  EXPECT_NEAR(1.0, double(tree.leafArea(leaf)) / area, 0.002);
  const Tracer tracer(tree);
  EXPECT_NEAR(0.5f, tracer.asvoAlbedo(leaf).x, 1.5f / 255.0f);
  EXPECT_GT(tracer.asvoNormal(leaf).y, 0.999f);
}

TEST(AsvoParts, TrianglesWithoutAreaChangeNothing) {
  Copies source;
  source.copies = 500;
  source.part = pyramid(0.004f, 0.002f);
  const Tree plain = Tree::build(source, unitCube(6));
  const vec3 a(-0.004f, 0.0f, 0.0f), b(0.004f, 0.001f, 0.0f);
  source.part.add(a, a, a);
  source.part.add(a, b, a);
  source.part.add(a, b, b);
  expectSameBits(plain, Tree::build(source, unitCube(6)));
}

// Depths that can't keep the limits are not tried; the tree is that of the depth that keeps them.
TEST(AsvoParts, DepthThatKeepsTheLimitsIsFoundAheadOfIt) {
  Copies source;
  source.copies = 3000;
  source.part.addBox(vec3(-0.02f), vec3(0.02f));
  const Tree coarse = Tree::build(source, unitCube(4));
  BuildOptions options = unitCube(9);
  options.maxLeaves = coarse.info.leafCount;
  expectSameBits(coarse, Tree::build(source, options));
  options.maxLeaves = 1u << 28;
  options.maxBytes = 40 * coarse.nodes.size() + 8 * coarse.leaves.size();
  expectSameBits(coarse, Tree::build(source, options));
  options.maxBytes -= 1;
  EXPECT_EQ(3u, Tree::build(source, options).info.depth);
}

bool isSet(const Tree& tree, const glm::ivec3& at) {
  std::uint32_t node = 0;
  for (auto level = static_cast<int>(tree.info.depth); level-- > 0;) {
    const glm::ivec3 bit = at >> (2 + level) & 1;
    const std::uint32_t octant = static_cast<std::uint32_t>(bit.x | bit.y << 1 | bit.z << 2);
    const std::uint32_t children = tree.nodes[node].y;
    if ((children >> octant & 1u) == 0) return false;
    node = tree.nodes[node].x +
           static_cast<std::uint32_t>(std::popcount(children & ((1u << octant) - 1u)));
  }
  const asvo::uvec2 mask = tree.leaves[node - tree.info.firstLeaf];
  const glm::ivec3 in = at & 3;
  const int number = in.x + 4 * in.y + 16 * in.z;
  return ((number < 32 ? mask.x >> number : mask.y >> (number - 32)) & 1u) != 0;
}

/// How far a triangle is from the cell of edge 1 at p along the axis that tells most.
double gap(const dvec3 (&v)[3], const dvec3& p) {
  std::vector<dvec3> axes = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  axes.push_back(glm::cross(v[1] - v[0], v[2] - v[0]));
  for (int e = 0; e < 3; ++e) {
    for (int axis = 0; axis < 3; ++axis) {
      axes.push_back(glm::cross(v[(e + 1) % 3] - v[e], axes[static_cast<std::size_t>(axis)]));
    }
  }
  double most = -1e300;
  for (const dvec3& axis : axes) {
    const double length = glm::length(axis);
    if (length < 1e-9) continue;
    const dvec3 n = axis / length;
    const double radius = 0.5 * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
    double low = 1e300, high = -1e300;
    for (const dvec3& corner : v) {
      low = std::min(low, glm::dot(n, corner - (p + 0.5)));
      high = std::max(high, glm::dot(n, corner - (p + 0.5)));
    }
    most = std::max({most, low - radius, -radius - high});
  }
  return most;
}

// A sub-voxel is set if the triangle touches it, and not if it is a few tolerances away.
TEST(AsvoParts, MasksAreThoseOfThePlainTest) {
  constexpr int kCells = 32;
  constexpr double kTolerance = kCells * 1e-6;
  Random random(7);
  for (int i = 0; i < 600; ++i) {
    const float size = std::pow(10.0f, random.uniform(-1.5f, 1.0f)) / kCells;
    const vec3 middle = random.point(0.35f, 0.65f);
    vec3 corner[3];
    for (vec3& c : corner) c = middle + size * random.point(-0.5f, 0.5f);
    if (i % 3 == 0) corner[1].y = corner[2].y = corner[0].y;  // flat, as walls are
    Shape shape;
    shape.add(corner[0], corner[1], corner[2]);
    const Tree tree = Tree::build(shape, unitCube(3));
    const dvec3 v[3] = {dvec3(corner[0]) * double(kCells), dvec3(corner[1]) * double(kCells),
                        dvec3(corner[2]) * double(kCells)};
    const glm::ivec3 low(glm::min(v[0], glm::min(v[1], v[2])) - 1.0);
    const glm::ivec3 high(glm::max(v[0], glm::max(v[1], v[2])) + 1.0);
    int found = 0, all = 0;
    for (int z = low.z; z <= high.z; ++z) {
      for (int y = low.y; y <= high.y; ++y) {
        for (int x = low.x; x <= high.x; ++x) {
          const bool set = isSet(tree, {x, y, z});
          const double distance = gap(v, dvec3(x, y, z));
          found += set ? 1 : 0;
          if (set) {
            EXPECT_LE(distance, 4.0 * kTolerance) << i << ' ' << x << ' ' << y << ' ' << z;
          } else {
            EXPECT_GT(distance, 0.0) << i << ' ' << x << ' ' << y << ' ' << z;
          }
        }
      }
    }
    for (const asvo::uvec2& mask : tree.leaves)
      all += std::popcount(mask.x) + std::popcount(mask.y);
    EXPECT_EQ(all, found) << i;
  }
}

}  // namespace
