// The builder: what stands in voxels, at any size, for any number of threads.
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>

#include <bit>
#include <cstring>
#include <set>

#include "asvo/tracer.h"
#include "tests/unit/asvo_shapes.h"

namespace {

using asvo::BuildOptions;
using asvo::Tracer;
using asvo::Tree;
using asvo_shapes::Random;
using asvo_shapes::Shape;
using glm::vec3;

Tree build(const Shape& shape, int depth) {
  BuildOptions options;
  options.depth = depth;
  Tree tree = Tree::build(shape, options);
  asvo::validate(tree);
  return tree;
}

double leafArea(const Tree& tree) {
  double sum = 0.0;
  for (std::uint32_t i = tree.info.firstLeaf; i < tree.info.nodeCount; ++i) {
    sum += static_cast<double>(tree.leafArea(i));
  }
  return sum;
}

/// Of the root, m^2.
float rootArea(const Tree& tree) {
  return Tracer(tree).asvoArea(0) * tree.info.size * tree.info.size;
}

float coverage(const Tree& tree, std::uint32_t voxel, int direction) {
  const Tracer tracer(tree);
  return static_cast<float>(
             tracer.asvoCoverage(tree.voxels[voxel], static_cast<asvo::uint>(direction))) /
         63.0f;
}

TEST(AsvoBuild, EmptySourceIsARootThatTracesNothing) {
  const Tree tree = Tree::build(Shape{});
  asvo::validate(tree);
  EXPECT_EQ(1u, tree.info.nodeCount);
  EXPECT_EQ(0u, tree.info.leafCount);
  const Tracer tracer(tree);
  Tracer::AsvoHit hit;
  EXPECT_FALSE(tracer.asvoIntersect(vec3(-1, 0.5f, 0.5f), vec3(1, 0, 0), 0.0f, 1e30f, hit));
  const auto cone = tracer.asvoGather(vec3(0.5f), vec3(1, 0, 0), 0.3f, 0.0f, 1e30f, 0.5f);
  EXPECT_EQ(1.0f, cone.transmittance);
  EXPECT_EQ(asvo::ASVO_NONE, tracer.asvoFindNear(vec3(0.5f), vec3(1, 0, 0), 1));
}

TEST(AsvoBuild, OneTriangle) {
  Shape shape;
  shape.constant = {vec3(0.25f, 0.5f, 1.0f), vec3(3.0f, 2.0f, 1.0f), false};
  shape.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 42);
  const Tree tree = build(shape, 5);
  const Tracer tracer(tree);
  EXPECT_NEAR(0.5, leafArea(tree), 2e-4);
  for (std::uint32_t i = 0; i < tree.info.nodeCount; ++i) {
    if (tracer.asvoArea(i) < 1e-5f) continue;
    EXPECT_EQ(42u, tracer.asvoMaterial(i));
    EXPECT_NEAR(0.0f, glm::length(tracer.asvoAlbedo(i) - vec3(0.25f, 0.5f, 1.0f)), 0.005f);
    EXPECT_GT(tracer.asvoNormal(i).z, 0.9999f);
    EXPECT_NEAR(0.0f, glm::length(tree.emission(i, true) - vec3(3, 2, 1)), 0.02f);
    EXPECT_EQ(vec3(0.0f), tree.emission(i, false));
    EXPECT_EQ(0.0f, coverage(tree, i, 5));
  }
  EXPECT_NEAR(0.5f, rootArea(tree), 3e-4f);
}

/// A box of which one material sends light by its direction.
class HalfMetal : public Shape {
 public:
  asvo::Shade shade(const asvo::Triangle& triangle, float, float) const override {
    return {vec3(0.5f), vec3(0.0f), false, triangle.material == 1};
  }
};

/// The share of faces that send light by their direction, where they lie on others too.
TEST(AsvoBuild, ShareByDirectionIsThatOfTheFaces) {
  HalfMetal shape;
  shape.addQuad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, 0);
  const Tree without = build(shape, 4);
  for (const auto& voxel : without.voxels) EXPECT_EQ(Tracer(without).asvoDirectional(voxel), 0u);
  shape.addQuad({0, 0, 0.001f}, {0.5f, 0, 0.001f}, {0.5f, 1, 0.001f}, {0, 1, 0.001f}, 1);
  const Tree tree = build(shape, 4);
  const Tracer tracer(tree);
  EXPECT_EQ(tracer.asvoDirectional(tree.voxels[0]), 2u);  // a third
  const std::uint32_t under = tracer.asvoFindNear(vec3(0.25f, 0.5f, 0.0f), vec3(0, 0, 1), 4);
  const std::uint32_t beside = tracer.asvoFindNear(vec3(0.8f, 0.5f, 0.0f), vec3(0, 0, 1), 4);
  EXPECT_GE(tracer.asvoDirectional(tree.voxels[under]), 2u);  // half
  EXPECT_EQ(tracer.asvoDirectional(tree.voxels[beside]), 0u);
}

TEST(AsvoBuild, AreaOfASphereIsKept) {
  Shape shape;
  shape.addSphere({0.1f, 0.2f, 0.3f}, 0.7f, 40);
  for (const int depth : {3, 6, 8}) {
    EXPECT_NEAR(1.0, leafArea(build(shape, depth)) / shape.area(), depth > 3 ? 1e-4 : 1e-3)
        << depth;
  }
}

// A wall exactly on a face between voxels counts once, whichever voxels hold it.
TEST(AsvoBuild, AreaOnFacesOfVoxelsIsNotCountedTwice) {
  Shape shape;
  shape.addQuad({0.1f, 0.1f, 0.5f}, {0.9f, 0.1f, 0.5f}, {0.9f, 0.9f, 0.5f}, {0.1f, 0.9f, 0.5f});
  BuildOptions options;
  options.depth = 4;
  options.size = 1.0f;
  EXPECT_NEAR(0.64, leafArea(Tree::build(shape, options)), 2e-4);
}

TEST(AsvoBuild, CoverageOfAnObliqueWallStaysAtEveryLevel) {
  Shape shape;  // through the whole cube, normal (1, 0, 1) / sqrt(2)
  shape.addQuad({0.0f, -0.5f, 1.0f}, {1.0f, -0.5f, 0.0f}, {1.0f, 1.5f, 0.0f}, {0.0f, 1.5f, 1.0f});
  BuildOptions options;
  options.depth = 6;
  options.size = 1.0f;
  const Tree tree = Tree::build(shape, options);
  for (std::uint32_t level = 0; level <= 6; ++level) {
    // The projection of the wall on the face of the cube is all of it, so is the sum of coverages.
    double sum = 0.0;
    for (auto i = tree.levelOffsets[level]; i < tree.levelOffsets[level + 1]; ++i) {
      sum += static_cast<double>(std::max(coverage(tree, i, 0), coverage(tree, i, 1)));
      EXPECT_LT(coverage(tree, i, 2) + coverage(tree, i, 3), 0.01f);
    }
    EXPECT_NEAR(1.0, sum / std::pow(4.0, level), 0.02) << "level " << level;
  }
}

TEST(AsvoBuild, ThinSlabDoesNotCancel) {
  Shape shape;
  shape.addBox({-1.0f, -1.0f, 0.001f}, {1.0f, 1.0f, 0.002f});
  const Tree tree = build(shape, 5);
  const Tracer tracer(tree);
  EXPECT_GT(std::abs(tracer.asvoNormal(0).z), 0.99f);
  EXPECT_NEAR(4.0f, rootArea(tree), 0.05f);
}

TEST(AsvoBuild, EmissionOfBothSidesKeepsItsPower) {
  Shape shape;
  shape.constant = {vec3(0.5f), vec3(2.0f), true};
  shape.addQuad({0, 0, 0.01f}, {1, 0, 0.2f}, {1, 1, 0.3f}, {0, 1, 0.11f});
  const Tree tree = build(shape, 6);
  for (const bool front : {true, false}) {
    const float power = tree.emission(0, front).x * rootArea(tree);
    EXPECT_NEAR(2.0, static_cast<double>(power) / shape.area(), 0.01);
  }
}

// Every point of every triangle lies in an occupied sub-voxel.
TEST(AsvoBuild, MasksAreConservative) {
  Shape shape;
  Random random(3);
  for (int i = 0; i < 300; ++i) {
    const vec3 a = random.point(-1, 1);
    const float size = i % 3 == 0 ? 1.5f : 0.05f;
    const vec3 b = a + size * random.direction(), c = a + size * random.direction();
    shape.add(a, b, c);
  }
  const Tree tree = build(shape, 6);
  const Tracer tracer(tree);
  std::uint64_t missing = 0;
  for (const auto& t : shape.triangles) {
    for (int i = 0; i < 2000; ++i) {
      const float r = std::sqrt(random.uniform()), v = random.uniform() * r;
      const vec3 p = t.position[0] * (1.0f - r) + t.position[1] * (r - v) + t.position[2] * v;
      const std::uint32_t voxel = tracer.asvoFind(p, 6);
      if (voxel == asvo::ASVO_NONE) {
        ++missing;
        continue;
      }
      const glm::uvec3 sub = glm::uvec3(tracer.asvoGridPosition(p, 8)) & 3u;
      const std::uint32_t bit = sub.x + 4 * sub.y + 16 * sub.z;
      const asvo::uvec2 leaf = tree.leaves[voxel - tree.info.firstLeaf];
      missing += ((bit < 32 ? leaf.x : leaf.y) >> (bit & 31) & 1u) == 0;
    }
  }
  EXPECT_EQ(0u, missing);
}

TEST(AsvoBuild, SameBitsForAnyNumberOfThreads) {
  Shape shape = asvo_shapes::cornellBox();
  shape.addSphere({0.5f, 0.5f, 0.5f}, 0.3f, 100);
  std::vector<std::byte> first;
  for (const int threads : {1, 2, 5}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 8);
    tbb::task_arena arena(threads);
    const auto bytes = arena.execute([&] { return build(shape, 7).toBytes(); });
    if (first.empty()) first = bytes;
    EXPECT_TRUE(first == bytes) << threads << " threads";
  }
}

TEST(AsvoBuild, ExtremeExtents) {
  for (const float scale : {1e-6f, 1.0f, 1e7f}) {
    Shape shape;
    shape.addBox(vec3(-scale), vec3(scale), asvo_shapes::rotationOf(30.0f, {1, 1, 0}));
    const Tree tree = build(shape, 6);
    EXPECT_NEAR(1.0, leafArea(tree) / shape.area(), 1e-3) << scale;
    const Tracer tracer(tree);
    Random random(9);
    for (int i = 0; i < 1000; ++i) {
      Tracer::AsvoHit hit;
      ASSERT_TRUE(tracer.asvoIntersect(vec3(0.0f), random.direction(), 0.0f, 10.0f * scale, hit));
      EXPECT_GT(hit.t, 0.9f * scale);
      EXPECT_LT(hit.t, 1.8f * scale);
    }
  }
}

TEST(AsvoBuild, DegenerateAndHostileTrianglesLeaveNoNaN) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  Shape shape;
  shape.constant = {vec3(nan, -1.0f, 1e30f), vec3(infinity, nan, -3.0f), true};
  shape.add({0, 0, 0}, {0, 0, 0}, {0, 0, 0});
  shape.add({0, 0, 0}, {1, 1, 1}, {0.5f, 0.5f, 0.5f});
  shape.add({nan, 0, 0}, {1, 0, 0}, {0, 1, 0});
  shape.add({infinity, 0, 0}, {1, 0, 0}, {0, 1, 0});
  shape.add({0, 0, 0}, {1, 0, 0}, {1, 1e-20f, 0});
  shape.add({0, 0, 0}, {1e-38f, 0, 1e-39f}, {0, 1e-38f, 0}, 0xffffffffu);
  shape.add({0, 0.3f, 0}, {1, 0.3f, 0}, {0.5f, 0.3001f, 1e-7f}, 70000);
  const Tree tree = build(shape, 6);
  const Tracer tracer(tree);
  EXPECT_GT(tree.info.leafCount, 60u);
  for (std::uint32_t i = 0; i < tree.info.nodeCount; ++i) {
    const vec3 normal = tracer.asvoNormal(i);
    EXPECT_NEAR(1.0f, glm::length(normal), 1e-3f);
    EXPECT_LE(tracer.asvoAlbedo(i).x, 0.0f);
    EXPECT_TRUE(std::isfinite(tree.emission(i, true).x));
  }
}

TEST(AsvoBuild, DepthFollowsTheLimits) {
  const Shape shape = asvo_shapes::cornellBox();
  BuildOptions options;
  options.maxLeaves = 30000;
  const Tree fewer = Tree::build(shape, options);
  EXPECT_EQ(6u, fewer.info.depth);
  EXPECT_LE(fewer.info.leafCount, 30000u);
  options.maxLeaves = 1'000'000;
  options.maxBytes = 2'000'000;
  const Tree small = Tree::build(shape, options);
  EXPECT_LE(small.nodes.size() * 40 + small.leaves.size() * 8, options.maxBytes);
  EXPECT_GE(small.info.depth, 4u);
  EXPECT_THROW(Tree::build(shape, {.depth = 13}), std::invalid_argument);
  EXPECT_THROW(Tree::build(shape, {.size = -1.0f}), std::invalid_argument);
}

// A box far from others gets leaves for its own size, as far as limits allow.
TEST(AsvoBuild, DepthGrowsWhereNearlyAllIsEmpty) {
  Shape shape;
  for (const float x : {-25.0f, 0.0f, 25.0f}) {
    shape.addBox(vec3(x, 0.0f, 0.0f) - 0.5f, vec3(x, 0.0f, 0.0f) + 0.5f);
  }
  BuildOptions options{.depth = 7};
  EXPECT_EQ(7u, Tree::build(shape, options).info.depth);
  options.deepen = true;
  const Tree fine = Tree::build(shape, options);
  EXPECT_GE(fine.info.depth, 10u);
  EXPECT_LE(fine.info.leafCount, 8u << 14);  // about as in a full cube
  options.maxLeaves = fine.info.leafCount - 1;
  EXPECT_EQ(fine.info.depth - 1, Tree::build(shape, options).info.depth);
  EXPECT_EQ(7u, Tree::build(asvo_shapes::cornellBox(), {.depth = 7, .deepen = true}).info.depth);
}

// More triangles in one leaf than are kept apart: their averages and areas stay.
TEST(AsvoBuild, CrowdedLeaf) {
  Shape shape;
  shape.addSphere(vec3(0.0f), 0.1f, 80);
  shape.add({1000, 0, 0}, {1000, 1, 0}, {1000, 0, 1});
  const Tree tree = build(shape, 5);
  EXPECT_NEAR(0.5 + 0.5 * (shape.area() - 0.5), leafArea(tree), 1e-3);
  const Tracer tracer(tree);
  const std::uint32_t crowded = tracer.asvoFind(vec3(0.05f, 0.0f, 0.0f), 5);
  ASSERT_NE(asvo::ASVO_NONE, crowded);
  EXPECT_NEAR(1.0, static_cast<double>(tree.leafArea(crowded)) / (0.5 * shape.area() - 0.25), 2e-3);
  EXPECT_NEAR(0.5f, tracer.asvoAlbedo(crowded).y, 0.01f);
}

}  // namespace
