// Rays against clusters: the nearest hit is that of a test of all triangles in double precision.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>
#include <limits>

#include "hccmesh_meshes.h"

using namespace hccm;
using namespace hccm::test;

namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();

bool traceAll(const Mesh& mesh, const Ray& ray, Hit& hit, bool backwards = false) {
  PreparedRay prepared = mesh.prepare(ray);
  bool found = false;
  for (std::uint32_t i = 0; i < mesh.clusterCount(); ++i)
    found |= mesh.intersect(backwards ? mesh.clusterCount() - 1 - i : i, prepared, hit);
  return found;
}
bool occludedAll(const Mesh& mesh, const Ray& ray) {
  const PreparedRay prepared = mesh.prepare(ray);
  bool found = false;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) found |= mesh.occluded(c, prepared);
  EXPECT_EQ(found, mesh.occluded(prepared)) << "through the top level";
  return found;
}
// Through the top level.
bool traceTop(const Mesh& mesh, const Ray& ray, Hit& hit) {
  PreparedRay prepared = mesh.prepare(ray);
  return mesh.intersect(prepared, hit);
}

// The same mesh, expanded.
Mesh expandedOf(const Mesh& mesh) {
  Mesh copy = Mesh::fromBytes(std::vector<std::byte>(mesh.bytes().begin(), mesh.bytes().end()));
  copy.expand();
  return copy;
}
void expectSame(const Hit& a, const Hit& b) {
  EXPECT_EQ(a.cluster, b.cluster);
  EXPECT_EQ(a.triangle, b.triangle);
  EXPECT_EQ(a.t, b.t);
  EXPECT_EQ(a.u, b.u);
  EXPECT_EQ(a.v, b.v);
}

// Nearest hit in double, and how surely: the least distance to an edge or end, in weights.
struct Truth {
  double t = std::numeric_limits<double>::infinity();
  bool sure = true;
};
Truth bruteForce(const Mesh& mesh, const Ray& ray) {
  const glm::dvec3 o(ray.origin), d(ray.direction);
  Truth best;
  std::vector<double> doubtful;
  for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c)
    forEachTriangle(mesh, c, [&](std::uint32_t i) {
      const Triangle tri = mesh.triangle(c, i);
      const glm::dvec3 a(tri.position[0]), e1 = glm::dvec3(tri.position[1]) - a,
                                           e2 = glm::dvec3(tri.position[2]) - a;
      const glm::dvec3 p = glm::cross(d, e2);
      const double det = glm::dot(e1, p);
      if (det == 0.0) return;
      const double u = glm::dot(o - a, p) / det;
      const glm::dvec3 q = glm::cross(o - a, e1);
      const double v = glm::dot(d, q) / det, t = glm::dot(e2, q) / det;
      // Rounding moves an edge by 2^-22 of the distance: in weights, over the triangle's height.
      const double height =
          std::abs(det) / (glm::length(d) * std::max(glm::length(e1), glm::length(e2)));
      const double blur = 1e-6 * (glm::length(o - a) + glm::length(e1) + glm::length(e2)) / height;
      const double margin = std::min({u, v, 1.0 - u - v});
      if (margin < -blur || t < double(ray.tnear) - 1e-6 || t > double(ray.tfar) + 1e-6) return;
      if (margin < blur || std::abs(t - ray.tnear) < 1e-6 || std::abs(t - double(ray.tfar)) < 1e-6)
        doubtful.push_back(t);
      else
        best.t = std::min(best.t, t);
    });
  for (double t : doubtful) best.sure = best.sure && t > best.t + 1e-5;
  return best;
}

void expectAgrees(const Mesh& mesh, const std::vector<Ray>& rays) {
  int sure = 0, hits = 0;
  const Mesh expanded = expandedOf(mesh);
  EXPECT_GT(expanded.topLevelBytes(), 32 * mesh.triangleCount());
  for (const Ray& ray : rays) {
    Hit hit, backwards;
    const bool found = traceAll(mesh, ray, hit);
    EXPECT_EQ(found, traceAll(mesh, ray, backwards, true));
    EXPECT_EQ(found, occludedAll(mesh, ray));
    EXPECT_EQ(found, expanded.occluded(expanded.prepare(ray)));
    Hit top, fast;
    EXPECT_EQ(found, traceTop(mesh, ray, top));
    EXPECT_EQ(found, traceTop(expanded, ray, fast));
    for (const Hit& other : {backwards, top, fast}) expectSame(hit, other);
    const Truth truth = bruteForce(mesh, ray);
    if (!truth.sure) continue;
    ++sure;
    hits += found;
    ASSERT_EQ(found, std::isfinite(truth.t)) << sure;
    if (found) {
      EXPECT_NEAR(hit.t, truth.t, 1e-5 * (1.0 + truth.t));
      const Triangle t = mesh.triangle(hit.cluster, hit.triangle);
      const glm::dvec3 p = glm::dvec3(t.position[0]) * (1.0 - hit.u - hit.v) +
                           glm::dvec3(t.position[1]) * hit.u + glm::dvec3(t.position[2]) * hit.v;
      const glm::dvec3 at = ray.origin + double(hit.t) * glm::dvec3(ray.direction);
      EXPECT_LT(glm::length(p - at), 1e-4 * (1.0 + double(hit.t)));
    }
  }
  EXPECT_GT(sure, int(rays.size()) * 8 / 10);
  EXPECT_GT(hits, int(rays.size()) / 10);
}

std::vector<Ray> randomRays(int count, unsigned seed, bool axisParallel) {
  std::mt19937 random(seed);
  std::vector<Ray> rays;
  for (int i = 0; i < count; ++i) {
    glm::vec3 d = glm::normalize(randomPoint(random, 1.0f) + glm::vec3(1e-4f));
    if (axisParallel) {
      d = glm::vec3(0.0f);
      d[i % 3] = i % 2 ? 1.0f : -1.0f;
      if (i % 5 == 0) d[(i + 1) % 3] = std::numeric_limits<float>::denorm_min();
      if (i % 7 == 0) d[(i + 2) % 3] = -0.0f;
    }
    rays.push_back({randomPoint(random, 1.5f), 0.0f, d, i % 4 ? kInf : 1.0f});
  }
  return rays;
}

// From one point through a raster, as a camera's or to a light.
std::vector<Ray> rasterRays(const glm::dvec3& from, int size) {
  std::vector<Ray> rays;
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) {
      const glm::vec3 to(2.0f * float(x) / float(size) - 1.0f, 2.0f * float(y) / float(size) - 1.0f,
                         0.1f);
      rays.push_back({from, 0.0f, glm::normalize(to - glm::vec3(from)), (x + y) % 9 ? kInf : 1.5f});
    }
  return rays;
}

// Every third ray does not see object 0 and passes material 1.
constexpr std::uint8_t kHidden[2] = {1, 0};
constexpr Passage kPassages[2] = {Passage::kBlocks, Passage::kPasses};

void expectSpansAgree(const Mesh& mesh, const std::vector<Ray>& rays, std::size_t size) {
  std::size_t met = 0;
  for (std::size_t first = 0; first < rays.size(); first += size) {
    const std::size_t count = std::min(size, rays.size() - first);
    std::vector<Passages> passages(2 * count, Passages{kPassages});
    std::vector<PreparedRay> alone(count);
    for (std::size_t i = 0; i < count; ++i) {
      alone[i] = mesh.prepare(rays[first + i]);
      if ((first + i) % 3 != 0) continue;
      alone[i].hidden = kHidden;
      alone[i].passages = &passages[i];
    }
    std::vector<PreparedRay> together = alone;
    for (std::size_t i = 0; i < count; ++i)
      if (together[i].passages != nullptr) together[i].passages = &passages[count + i];
    std::vector<std::uint8_t> blocked(count);
    mesh.occluded(together, blocked);
    std::vector<Hit> hits(count);
    mesh.intersect(together, hits);
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_EQ(mesh.occluded(alone[i]), blocked[i] == 1);
      if (!blocked[i]) {
        EXPECT_EQ(passages[i].met, passages[count + i].met);
      }
      Hit hit;
      met += mesh.intersect(alone[i], hit);
      expectSame(hit, hits[i]);
      EXPECT_EQ(alone[i].tfar, together[i].tfar);
    }
  }
  EXPECT_GT(met, rays.size() / 8);
}

}  // namespace

TEST(HccMeshTrace, NearestHitOfRandomRays) {
  expectAgrees(build(randomSoup(600, 1.0f, 21)), randomRays(2000, 22, false));
}
TEST(HccMeshTrace, AxisParallelRaysWithZeroAndDenormalComponents) {
  expectAgrees(build(randomSoup(600, 1.0f, 23)), randomRays(2000, 24, true));
}
TEST(HccMeshTrace, ConnectedMesh) {
  Soup s = sheet(40, 2.0f);
  expectAgrees(build(s), randomRays(1000, 25, false));
}
TEST(HccMeshTrace, DirectionNeedNotBeUnit) {
  const Mesh mesh = build(randomSoup(300, 1.0f, 26));
  for (Ray ray : randomRays(300, 27, false)) {
    ray.tfar = kInf;
    Hit a, b;
    const bool found = traceAll(mesh, ray, a);
    ray.direction *= 0.125f;
    ASSERT_EQ(found, traceAll(mesh, ray, b));
    if (found) {
      EXPECT_FLOAT_EQ(a.t * 8.0f, b.t);
    }
  }
}

TEST(HccMeshTrace, EveryInstructionSetGivesTheSameBits) {
  const Soup soup = randomSoup(800, 1.0f, 28), wide = randomSoup(30, 1.0f, 29);
  const std::vector<Ray> rays = randomRays(3000, 30, false);
  std::vector<std::vector<Hit>> results;
  std::vector<std::string> names;
  for (std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    const Mesh a = build(soup), b = build(wide);
    const Mesh fastA = expandedOf(a), fastB = expandedOf(b);
    names.emplace_back(a.targetName());
    std::vector<Hit>& hits = results.emplace_back();
    for (const Ray& ray : rays)
      for (const auto& [mesh, fast] : {std::pair(&a, &fastA), std::pair(&b, &fastB)}) {
        Hit hit, expanded;
        const bool found = traceAll(*mesh, ray, hit);
        EXPECT_EQ(found, occludedAll(*mesh, ray));
        EXPECT_EQ(found, traceTop(*fast, ray, expanded));
        EXPECT_EQ(found, fast->occluded(fast->prepare(ray)));
        expectSame(hit, expanded);
        hits.push_back(hit);
      }
  }
  hwy::SetSupportedTargetsForTest(0);
  ASSERT_GE(results.size(), 1u);
  for (std::size_t k = 1; k < results.size(); ++k)
    for (std::size_t i = 0; i < results[k].size(); ++i) {
      ASSERT_EQ(results[0][i].triangle, results[k][i].triangle) << names[k];
      ASSERT_EQ(results[0][i].cluster, results[k][i].cluster) << names[k];
      ASSERT_EQ(results[0][i].t, results[k][i].t) << names[k];
      ASSERT_EQ(results[0][i].u, results[k][i].u) << names[k];
    }
}

// From afar, off and onto surfaces, past hidden objects and materials that let rays pass.
TEST(HccMeshTrace, ExpandedMeshesGiveTheSameBitsToEveryKindOfRay) {
  Soup near = randomSoup(700, 1.0f, 61), other = randomSoup(700, 1.0f, 62);
  std::vector<Part> parts{near.part(), other.part()};
  parts[0].material = 0, parts[0].object = 0;
  parts[1].material = 1, parts[1].object = 1;
  const Mesh mesh = Mesh::build(parts), fast = expandedOf(mesh);
  std::mt19937 random(63);
  int found = 0;
  for (int i = 0; i < 4000; ++i) {
    const float away = std::exp2(static_cast<float>(i % 40));
    Ray ray{randomPoint(random, away), 0.0f, {}, i % 3 ? kInf : 2.0f * away};
    ray.direction = glm::normalize(randomPoint(random, 1.0f) - glm::vec3(ray.origin));
    if (i % 4 == 1) ray.slack = 1e-3;
    if (i % 4 == 2) ray.fromCluster = i % mesh.clusterCount(), ray.fromTriangle = i % 200;
    if (i % 4 == 3) ray.target = randomPoint(random, 1.0f), ray.targetSlack = 1e-2;
    const std::uint8_t hidden[2] = {i % 5 == 0, i % 7 == 0};
    const auto prepare = [&](const Mesh& of) {
      PreparedRay prepared = of.prepare(ray);
      if (i % 2) prepared.hidden = hidden;
      return prepared;
    };
    PreparedRay a = prepare(mesh), b = prepare(fast);
    Hit hit, same;
    EXPECT_EQ(mesh.intersect(a, hit), fast.intersect(b, same));
    expectSame(hit, same);
    found += hit.cluster != Hit::kNothing;
    const Passage of[2] = {i % 3 == 0   ? Passage::kAbsent
                           : i % 3 == 1 ? Passage::kPasses
                                        : Passage::kBlocks,
                           i % 2 ? Passage::kPasses : Passage::kBlocks};
    Passages passA{of}, passB{of};
    a = prepare(mesh), b = prepare(fast);
    a.passages = &passA, b.passages = &passB;
    const bool blocked = mesh.occluded(a);
    EXPECT_EQ(blocked, fast.occluded(b));
    if (!blocked) {
      EXPECT_EQ(passA.met, passB.met);  // of a blocked ray it is told by chance
    }
  }
  EXPECT_GT(found, 400);
}

TEST(HccMeshTrace, SpansOfRaysGiveTheBitsOfSingleRays) {
  const Soup bumps = sheet(40, 2.0f), soup = randomSoup(700, 1.0f, 71);
  std::vector<Part> parts{bumps.part(), soup.part()};
  parts[1].material = parts[1].object = 1;
  std::vector<Ray> rays = rasterRays({0.2, 0.1, 3.0}, 40);
  for (const Ray& ray : rasterRays({3e7, 2e7, 1e8}, 9)) rays.push_back(ray);  // beyond floats
  for (const Ray& ray : randomRays(1000, 72, false)) rays.push_back(ray);
  for (std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    const Mesh mesh = Mesh::build(parts), fast = expandedOf(mesh);
    SCOPED_TRACE(mesh.targetName());
    for (const std::size_t size : {std::size_t{3}, std::size_t{16}, rays.size()}) {
      expectSpansAgree(mesh, rays, size);
      expectSpansAgree(fast, rays, size);
    }
  }
  hwy::SetSupportedTargetsForTest(0);
}

TEST(HccMeshTrace, EqualDistanceTakesTheLowerTriangle) {
  Soup s;
  s.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  for (int i = 0; i < 700; ++i) s.triangles.push_back({0, 1, 2});
  const Mesh mesh = build(s);
  ASSERT_GT(mesh.clusterCount(), 2u);
  const Ray ray{glm::vec3(-0.2f, -0.2f, 1.0f), 0.0f, glm::vec3(0, 0, -1), kInf};
  Hit forwards, backwards, top;
  ASSERT_TRUE(traceAll(mesh, ray, forwards));
  ASSERT_TRUE(traceAll(mesh, ray, backwards, true));
  ASSERT_TRUE(traceTop(mesh, ray, top));
  for (const Hit& hit : {forwards, backwards, top}) {
    EXPECT_EQ(hit.cluster, 0u);
    EXPECT_EQ(hit.triangle, 0u);
    EXPECT_FLOAT_EQ(hit.t, 1.0f);
  }
}

TEST(HccMeshTrace, IntervalIsClosedAndEmptyOnesHitNothing) {
  Soup s;
  s.positions = {{-1, -1, 0}, {1, -1, 0}, {0, 1, 0}};
  s.triangles = {{0, 1, 2}};
  const Mesh mesh = build(s);
  const glm::vec3 o(0.0f, 0.0f, 2.0f), d(0.0f, 0.0f, -1.0f);
  Hit hit;
  EXPECT_TRUE(traceAll(mesh, {o, 2.0f, d, 2.0f}, hit));
  EXPECT_FALSE(occludedAll(mesh, {o, 2.001f, d, kInf}));
  EXPECT_FALSE(occludedAll(mesh, {o, 0.0f, d, 1.999f}));
  EXPECT_FALSE(occludedAll(mesh, {o, 3.0f, d, 1.0f}));
  EXPECT_FALSE(occludedAll(mesh, {o, 0.0f, glm::vec3(0.0f), kInf}));
  EXPECT_FALSE(occludedAll(mesh, {o, 0.0f, glm::vec3(kInf, 0, 0), kInf}));
  EXPECT_FALSE(occludedAll(mesh, {o, 0.0f, glm::vec3(std::nanf(""), 0, -1), kInf}));
  EXPECT_FALSE(occludedAll(mesh, {glm::vec3(std::nanf("")), 0.0f, d, kInf}));
}

TEST(HccMeshTrace, EdgesOfASheetHoldFromAnyDistance) {
  const Soup s = sheet(60);
  const Mesh mesh = build(s);
  std::mt19937 random(31);
  for (float distance : {0.5f, 10.0f, 1e3f, 1e7f, 1e12f})
    for (int i = 0; i < 2000; ++i) {
      // The sheet is flat enough to be met from above at any of its inner vertices.
      const auto at = static_cast<std::uint32_t>((10 + random() % 40) * 61 + 10 + random() % 40);
      const glm::vec3 target = s.positions[at] - glm::vec3(mesh.gridOrigin());
      const glm::vec3 origin = glm::vec3(target.x, target.y, distance);
      Hit hit;
      ASSERT_TRUE(traceAll(mesh, {origin, 0.0f, glm::vec3(0, 0, -1), kInf}, hit)) << distance;
      EXPECT_NEAR(hit.t / distance, 1.0, 0.5);
    }
}
