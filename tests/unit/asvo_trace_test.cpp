// The tracer: watertight, exact on planes, right in the furnace, no leaks through thin walls.
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "asvo/tracer.h"
#include "tests/unit/asvo_shapes.h"

namespace {

using asvo::BuildOptions;
using asvo::Tracer;
using asvo::Tree;
using asvo::uint;
using asvo_shapes::Random;
using asvo_shapes::rotationOf;
using asvo_shapes::Shape;
using glm::mat3;
using glm::vec3;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

Tree build(const Shape& shape, int depth) {
  BuildOptions options;
  options.depth = depth;
  return Tree::build(shape, options);
}

/// Rays from inside that were not stopped.
int leaks(const Tree& tree, int count, float reach, std::uint32_t seed) {
  const Tracer tracer(tree);
  Random random(seed);
  int missed = 0;
  for (int i = 0; i < count; ++i) {
    const vec3 origin = random.point(-reach, reach);
    vec3 direction = random.direction();
    if (i % 8 == 0) direction[i / 8 % 3] = 0.0f;
    if (i % 32 == 0) direction[(i / 32 + 1) % 3] = i % 64 == 0 ? 1e-41f : -1e-30f;
    direction = glm::normalize(direction);
    Tracer::AsvoHit hit;
    missed += !tracer.asvoIntersect(origin, direction, 0.0f, kInfinity, hit);
  }
  return missed;
}

TEST(AsvoTrace, NoRayLeavesAClosedBox) {
  for (const float degrees : {0.0f, 15.0f, 45.0f}) {
    Shape shape;
    shape.addBox(vec3(-1), vec3(1), rotationOf(degrees, {0.3f, 1.0f, 0.1f}));
    EXPECT_EQ(0, leaks(build(shape, 7), 150000, 0.5f, 1)) << degrees;
  }
}

TEST(AsvoTrace, NoRayLeavesASphere) {
  for (const int rings : {12, 150}) {
    Shape shape;
    shape.addSphere(vec3(0.0f), 1.0f, rings);
    EXPECT_EQ(0, leaks(build(shape, 6), 250000, 0.5f, 2)) << rings;
    EXPECT_EQ(0, leaks(build(shape, 9), 50000, 0.5f, 3)) << rings;
  }
}

TEST(AsvoTrace, NoRayLeavesAFarSphere) {
  Shape shape;
  shape.addSphere(vec3(0.0f), 1.0f, 30);
  for (auto& triangle : shape.triangles) {
    for (vec3& p : triangle.position) p += vec3(1000.0f, -2000.0f, 500.0f);
  }
  const Tree tree = build(shape, 7);
  const Tracer tracer(tree);
  Random random(4);
  for (int i = 0; i < 50000; ++i) {
    Tracer::AsvoHit hit;
    const vec3 origin = vec3(1000.0f, -2000.0f, 500.0f) + random.point(-0.5f, 0.5f);
    ASSERT_TRUE(tracer.asvoIntersect(origin, random.direction(), 0.0f, kInfinity, hit)) << i;
  }
}

// Rays along the axes and through edges and corners of cells, where rounding decides the next cell.
TEST(AsvoTrace, NoRayThroughEdgesAndCornersOfCells) {
  Shape shape;
  shape.addBox(vec3(0.2f), vec3(0.8f), mat3(1.0f));
  shape.addBox(vec3(0.25f), vec3(0.75f), mat3(1.0f));  // on faces of voxels
  BuildOptions options;
  options.depth = 6;
  options.size = 1.0f;
  const Tree tree = Tree::build(shape, options);
  const Tracer tracer(tree);
  for (int i = 0; i < 27 * 4096; ++i) {
    const vec3 way(i % 3 - 1, i / 3 % 3 - 1, i / 9 % 3 - 1);
    if (way == vec3(0.0f)) continue;
    const int place = i / 27;  // corners of sub-voxels around the centre
    const vec3 origin =
        vec3(0.5f) + vec3(place % 16 - 8, place / 16 % 16 - 8, place / 256 - 8) / 256.0f;
    Tracer::AsvoHit hit;
    ASSERT_TRUE(tracer.asvoIntersect(origin, glm::normalize(way), 0.0f, kInfinity, hit)) << i;
    EXPECT_LT(hit.t, 0.5f);
    // From outside, starting on faces of the cube and beyond it.
    const vec3 from = origin + way * (i % 2 == 0 ? 0.5f : 100.0f);
    ASSERT_TRUE(tracer.asvoIntersect(from, -glm::normalize(way), 0.0f, kInfinity, hit)) << i;
  }
}

TEST(AsvoTrace, OddRaysEndAndHitNothing) {
  Shape shape;
  shape.addBox(vec3(-1), vec3(1));
  const Tree tree = build(shape, 5);
  const Tracer tracer(tree);
  Tracer::AsvoHit hit;
  EXPECT_FALSE(tracer.asvoIntersect(vec3(0.0f), vec3(1, 0, 0), 0.0f, 0.5f, hit));
  EXPECT_FALSE(tracer.asvoIntersect(vec3(0.0f), vec3(1, 0, 0), 2.0f, kInfinity, hit));
  EXPECT_FALSE(tracer.asvoIntersect(vec3(0.0f), vec3(1, 0, 0), 1.0f, 0.5f, hit));
  EXPECT_FALSE(tracer.asvoIntersect(vec3(5, 5, 0), vec3(0, 0, 1), 0.0f, kInfinity, hit));
  EXPECT_FALSE(tracer.asvoIntersect(vec3(1e30f, 0, 0), vec3(1, 0, 0), 0.0f, kInfinity, hit));
  EXPECT_TRUE(tracer.asvoIntersect(vec3(1e4f, 0, 0), vec3(-1, 0, 0), 0.0f, kInfinity, hit));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  tracer.asvoIntersect(vec3(nan), vec3(nan), nan, nan, hit);
  tracer.asvoIntersect(vec3(0.0f), vec3(0.0f), 0.0f, kInfinity, hit);
  tracer.asvoGather(vec3(nan), vec3(nan), nan, nan, nan, nan);
}

/// Distance of the nearest of all triangles [Moeller and Trumbore 1997], in double.
std::optional<double> exactHit(const Shape& shape, const vec3& origin, const vec3& direction) {
  std::optional<double> nearest;
  const glm::dvec3 o(origin), d(direction);
  for (const auto& t : shape.triangles) {
    const glm::dvec3 a(t.position[0]), e1 = glm::dvec3(t.position[1]) - a;
    const glm::dvec3 e2 = glm::dvec3(t.position[2]) - a, p = glm::cross(d, e2);
    const double inverse = 1.0 / glm::dot(e1, p);
    const glm::dvec3 q = glm::cross(o - a, e1);
    const double u = glm::dot(o - a, p) * inverse, v = glm::dot(d, q) * inverse;
    const double distance = glm::dot(e2, q) * inverse;
    if (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0 &&
        distance < nearest.value_or(1e30)) {
      nearest = distance;
    }
  }
  return nearest;
}

TEST(AsvoTrace, PlaneHitsAreWithinASubVoxel) {
  Shape shape;
  shape.addBox(vec3(-1), vec3(1), rotationOf(25.0f, {1, 2, 3}));
  shape.addSphere({0.2f, 0.1f, 0.0f}, 0.4f, 24);
  const Tree tree = build(shape, 7);
  const Tracer tracer(tree);
  const float subVoxel = tree.info.size / 512.0f;
  Random random(7);
  double sum = 0.0;
  int planar = 0, blocky = 0, wrong = 0;
  for (int i = 0; i < 20000; ++i) {
    const vec3 origin = random.point(-0.5f, 0.5f), direction = random.direction();
    Tracer::AsvoHit hit;
    if (glm::distance(origin, vec3(0.2f, 0.1f, 0.0f)) < 0.45f) continue;
    ASSERT_TRUE(tracer.asvoIntersect(origin, direction, 0.0f, kInfinity, hit));
    // Grazing rays may see a surface a fraction of a sub-voxel before it is there: measured along
    // the normal, as distance along the ray grows without bound.
    const auto exact = exactHit(shape, origin, direction);
    const double error = std::abs(static_cast<double>(hit.t) - *exact) *
                         static_cast<double>(std::abs(glm::dot(direction, hit.normal)) / subVoxel);
    const bool hasPlane = tracer.asvoHasPlane(hit.voxel);
    wrong += error > (hasPlane ? 1.0 : 4.0);
    (hasPlane ? planar : blocky) += 1;
    if (hasPlane) sum += std::min(error, 1.0);
    EXPECT_LE(glm::dot(hit.normal, direction), 0.0f);
  }
  EXPECT_GT(planar, 10 * blocky);
  EXPECT_LT(wrong, 20000 / 200);  // silhouettes: the mask is larger than the surface
  EXPECT_LT(sum / planar, 0.15);
}

struct FurnaceCase {
  float degrees, tanHalf;
};

class AsvoFurnace : public ::testing::TestWithParam<FurnaceCase> {};

// In a closed box whose irradiance is E everywhere, a cone sees albedo * E / pi.
TEST_P(AsvoFurnace, ConesSeeTheConstantRadiance) {
  const auto [degrees, tanHalf] = GetParam();
  Shape shape;
  shape.addBox(vec3(-1), vec3(1), rotationOf(degrees, {0.3f, 1.0f, 0.1f}));
  const Tree tree = build(shape, 7);
  const Tracer plain(tree);
  const float irradiance = 2.0f;
  const auto light = asvo_shapes::constantLight(tree, plain.asvoPackRgb9e5(vec3(irradiance)));
  const Tracer tracer(tree, light);
  const double expected = 0.5 * static_cast<double>(irradiance) / std::numbers::pi;
  Random random(11);
  double sum = 0.0, transmittance = 0.0, worst = 0.0;
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    const vec3 origin = random.point(-0.6f, 0.6f), direction = random.direction();
    const float jitter = random.uniform();
    const auto cone = tracer.asvoGather(origin, direction, tanHalf, 0.05f, kInfinity, jitter);
    sum += static_cast<double>(cone.radiance.x);
    transmittance += static_cast<double>(cone.transmittance);
    worst = std::max(worst, static_cast<double>(cone.transmittance));
    // What is not radiance is transmittance: nothing is lost or made.
    EXPECT_NEAR(1.0, static_cast<double>(cone.radiance.x) / expected + cone.transmittance, 0.01);
  }
  RecordProperty("transmittance", std::to_string(transmittance / kCount));
  EXPECT_NEAR(1.0, sum / kCount / expected, 0.03) << "worst transmittance " << worst;
  EXPECT_LT(transmittance / kCount, 0.01) << "worst " << worst;
}

INSTANTIATE_TEST_SUITE_P(Apertures, AsvoFurnace,
                         ::testing::Values(FurnaceCase{0, 0.0f}, FurnaceCase{0, 0.05f},
                                           FurnaceCase{0, 0.15f}, FurnaceCase{0, 0.3f},
                                           FurnaceCase{0, 0.6f}, FurnaceCase{15, 0.0f},
                                           FurnaceCase{15, 0.05f}, FurnaceCase{15, 0.15f},
                                           FurnaceCase{15, 0.3f}, FurnaceCase{15, 0.6f},
                                           FurnaceCase{45, 0.15f}, FurnaceCase{45, 0.3f},
                                           FurnaceCase{45, 0.6f}));

/// Largest transmittance of cones that cross a wall as thick as `voxels` leaves.
double wallTransmittance(float voxels, float degrees, float tanHalf, float distance) {
  const mat3 rotation = rotationOf(degrees, {0.2f, 1.0f, 0.3f});
  const float voxel = 2.2f / 128.0f;
  Shape shape;
  shape.addBox(vec3(-1, -1, -0.5f * voxels * voxel), vec3(1, 1, 0.5f * voxels * voxel), rotation);
  const Tree tree = build(shape, 7);
  const Tracer tracer(tree);
  Random random(13);
  double worst = 0.0;
  for (int i = 0; i < 5000; ++i) {
    const vec3 target(random.uniform(-0.5f, 0.5f), random.uniform(-0.5f, 0.5f), 0.0f);
    vec3 way = random.direction();
    if (std::abs(way.z) < 0.2f) continue;
    const vec3 origin = target - way * (distance * voxel);
    const float jitter = random.uniform();
    worst =
        std::max(worst, static_cast<double>(tracer.asvoTransmittance(
                            rotation * origin, rotation * way, tanHalf, 0.0f, kInfinity, jitter)));
  }
  return worst;
}

TEST(AsvoTrace, ThinWallsDoNotLeak) {
  for (const float voxels : {0.5f, 1.0f, 2.0f}) {
    for (const float degrees : {0.0f, 15.0f, 45.0f}) {
      EXPECT_LT(wallTransmittance(voxels, degrees, 0.02f, 12.0f), 0.02)
          << voxels << " voxels, " << degrees << " degrees";
    }
  }
}

// A cone that leaves a floor is not blocked by the floor, at any level and turn.
TEST(AsvoTrace, FloorsDoNotBlockWhatLeavesThem) {
  for (const float degrees : {0.0f, 20.0f}) {
    const mat3 rotation = rotationOf(degrees, {0.3f, 1.0f, 0.1f});
    Shape shape;
    shape.addQuad(rotation * vec3(-1, -1, 0), rotation * vec3(1, -1, 0), rotation * vec3(1, 1, 0),
                  rotation * vec3(-1, 1, 0));
    const Tree tree = build(shape, 7);
    const Tracer tracer(tree);
    const float voxel = tree.info.size / 128.0f;
    for (const float tanHalf : {0.0f, 0.15f, 0.3f, 0.6f}) {
      Random random(3);
      double sum = 0.0;
      for (int i = 0; i < 5000; ++i) {
        const float x = random.uniform(-0.5f, 0.5f);
        const vec3 origin(x, random.uniform(-0.5f, 0.5f), 1.5f * voxel);
        const vec3 way = glm::normalize(vec3(0, 0, 1) + 0.999f * random.direction());
        sum += static_cast<double>(tracer.asvoTransmittance(
            rotation * origin, rotation * way, tanHalf, 3.0f * voxel, kInfinity, random.uniform()));
      }
      EXPECT_GT(sum / 5000, 0.99) << degrees << " degrees, tan " << tanHalf;
    }
  }
}

// Small triangles at random: what a cone lets through is near what rays between them find.
TEST(AsvoTrace, ScatteredTrianglesStayTransparent) {
  Shape shape;
  Random random(5);
  for (int i = 0; i < 1500; ++i) {
    const vec3 a = random.point(-0.5f, 0.5f), b = a + 0.06f * random.direction();
    shape.add(a, b, a + 0.06f * random.direction());
  }
  BuildOptions options;
  options.depth = 7;
  options.lower = vec3(-1.0f);
  options.size = 2.0f;
  const Tree tree = Tree::build(shape, options);
  const Tracer tracer(tree);
  double cones = 0.0, rays = 0.0;
  for (int i = 0; i < 2000; ++i) {
    const vec3 target = random.point(-0.4f, 0.4f), way = random.direction();
    const vec3 origin = target - 0.9f * way;
    cones += static_cast<double>(
        tracer.asvoTransmittance(origin, way, 0.15f, 0.0f, kInfinity, random.uniform()));
    rays += exactHit(shape, origin, way) ? 0.0 : 1.0;
  }
  EXPECT_NEAR(rays / 2000, cones / 2000, 0.12);
}

TEST(AsvoTrace, FindReturnsTheVoxelOfEachLevel) {
  const Tree tree = build(asvo_shapes::cornellBox(), 6);
  const Tracer tracer(tree);
  const vec3 p(0.3f, -1.0f, 0.7f);
  for (uint level = 0; level <= 6; ++level) {
    const uint voxel = tracer.asvoFind(p, level);
    ASSERT_NE(asvo::ASVO_NONE, voxel);
    EXPECT_GE(voxel, tree.levelOffsets[level]);
    EXPECT_LT(voxel, tree.levelOffsets[level + 1]);
  }
  EXPECT_EQ(asvo::ASVO_NONE, tracer.asvoFind(vec3(0.0f, 0.9f, 0.0f), 6));
  EXPECT_EQ(asvo::ASVO_NONE, tracer.asvoFind(vec3(9.0f), 6));
}

TEST(AsvoTrace, FindNearReachesTheNextVoxel) {
  Shape shape;
  shape.addQuad({0.1f, 0.1f, 0.51f}, {0.9f, 0.1f, 0.51f}, {0.9f, 0.9f, 0.51f}, {0.1f, 0.9f, 0.51f});
  BuildOptions options;
  options.depth = 4;  // voxels of 1/16: the wall lies in those from 0.5 to 0.5625
  options.size = 1.0f;
  const Tree tree = Tree::build(shape, options);
  const Tracer tracer(tree);
  const vec3 n(0, 0, 1);
  const uint on = tracer.asvoFind(vec3(0.52f, 0.52f, 0.51f), 4);
  EXPECT_EQ(on, tracer.asvoFindNear(vec3(0.52f, 0.52f, 0.51f), n, 4));
  EXPECT_EQ(on, tracer.asvoFindNear(vec3(0.52f, 0.52f, 0.49f), n, 4));
  EXPECT_EQ(on, tracer.asvoFindNear(vec3(0.52f, 0.52f, 0.58f), n, 4));
  EXPECT_EQ(on, tracer.asvoFindNear(vec3(0.52f, 0.52f, 0.45f), vec3(1, 0, 0), 4));
  EXPECT_EQ(asvo::ASVO_NONE, tracer.asvoFindNear(vec3(0.52f, 0.52f, 0.8f), n, 4));
}

TEST(AsvoTrace, PackedValuesRoundTrip) {
  const Tree tree = build(asvo_shapes::cornellBox(), 1);
  const Tracer tracer(tree);
  Random random(17);
  for (int i = 0; i < 20000; ++i) {
    const vec3 n = random.direction();
    EXPECT_LT(glm::distance(n, tracer.asvoOctDecode(tracer.asvoOctEncode(n))), 1e-4f);
    const vec3 v = random.point(0.0f, 1.0f) * std::exp2(random.uniform(-13.0f, 15.5f));
    const float top = std::max(v.x, std::max(v.y, v.z));
    const vec3 w = tracer.asvoUnpackRgb9e5(tracer.asvoPackRgb9e5(v));
    EXPECT_LT(glm::distance(v, w), top * 0.0035f);
  }
  EXPECT_EQ(vec3(0.0f), tracer.asvoUnpackRgb9e5(tracer.asvoPackRgb9e5(vec3(-1, 0, -1e30f))));
  EXPECT_EQ(65408.0f, tracer.asvoUnpackRgb9e5(tracer.asvoPackRgb9e5(vec3(1e9f))).x);
  EXPECT_EQ(
      0.0f,
      tracer.asvoUnpackRgb9e5(tracer.asvoPackRgb9e5(vec3(std::numeric_limits<float>::quiet_NaN())))
          .x);
  // Exact values stay: powers of two, and the largest mantissa.
  for (int e = -15; e < 16; ++e) {
    const float x = std::ldexp(511.0f / 512.0f, e + 1);
    EXPECT_EQ(x, tracer.asvoUnpackRgb9e5(tracer.asvoPackRgb9e5(vec3(x))).y) << e;
  }
}

}  // namespace
