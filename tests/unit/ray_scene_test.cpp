// The scene under Embree: no cracks, instances, surfaces.
#include <gtest/gtest.h>

#include "tests/bench/bumpy_sphere.h"
#include "tests/bench/crack.h"

using namespace trex;

namespace {

std::uint64_t crackRaysThrough(const Scene& scene, std::uint64_t count, double distance) {
  const RayScene rays(scene);
  std::uint64_t through = 0;
  for (std::uint64_t i = 0; i < count; ++i)
    through += !bench::crackRayHits(rays, scene, i, distance);
  return through;
}

dmat4 moved(const dvec3& by) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(by, 1.0);
  return m;
}

// A quad of two triangles in the plane z = 0, facing +z, texture as in glTF (v down).
Mesh quad() {
  Mesh m;
  m.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  m.texCoords = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  m.triangles = {{0, 1, 2}, {0, 2, 3}};
  return m;
}

Scene texturedQuad() {
  Scene s = bench::sceneOf(quad());
  s.images.emplace_back();
  s.materials[0].normalTexture.image = 0;
  return s;
}

Surface hitSurface(const RayScene& rays, const vec3& origin, const vec3& direction) {
  RayHit hit;
  EXPECT_TRUE(rays.intersect(origin, direction, 0.0f, kInfinity, hit));
  return rays.surface(hit);
}

void expectNear(const vec3& a, const vec3& b, float tolerance = 1e-5f) {
  EXPECT_LT(glm::length(a - b), tolerance) << a.x << " " << a.y << " " << a.z;
}

}  // namespace

TEST(RayScene, NoRayPassesAnEdgeOrVertexNear) {
  EXPECT_EQ(crackRaysThrough(bench::sceneOf(bench::bumpySphere(60, false)), 500000, 0.0), 0u);
}

TEST(RayScene, NoRayPassesAnEdgeOrVertexFarFromTheWorldsOrigin) {
  Scene scene = bench::sceneOf(bench::bumpySphere(60, false));
  scene.instances[0].transform = moved({5e6, -3e6, 4e6});
  EXPECT_EQ(crackRaysThrough(scene, 300000, 0.0), 0u);
  scene.meshes[0].origin = dvec3(-5e6, 5e6, 1e6);
  EXPECT_EQ(crackRaysThrough(scene, 100000, 0.0), 0u);
}

TEST(RayScene, NoRayPassesAnEdgeOrVertexFromAfar) {
  const Scene scene = bench::sceneOf(bench::bumpySphere(60, false));
  EXPECT_EQ(crackRaysThrough(scene, 100000, 1e3), 0u);
  EXPECT_EQ(crackRaysThrough(scene, 100000, 1e7), 0u);
}

TEST(RayScene, NoRayPassesAnEdgeOfAnInstance) {
  Scene scene = bench::sceneOf(bench::bumpySphere(40, false));
  scene.instances[0].transform =
      dmat4(glm::dmat3(0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6));
  scene.instances.push_back(scene.instances[0]);
  scene.instances[1].transform[3] = glm::dvec4(100.0, 0.0, 0.0, 1.0);
  ASSERT_EQ(RayScene(scene).statistics().instances, 2u);
  EXPECT_EQ(crackRaysThrough(scene, 200000, 0.0), 0u);
}

TEST(RayScene, EmptySceneHitsNothing) {
  Scene scene;
  scene.materials.emplace_back();
  const RayScene rays(scene);
  RayHit hit;
  EXPECT_FALSE(rays.intersect(vec3(0.0f), vec3(0, 0, 1), 0.0f, kInfinity, hit));
  EXPECT_FALSE(rays.occluded(vec3(0.0f), vec3(0, 0, 1), 0.0f, kInfinity));
  EXPECT_TRUE(rays.bounds().empty());
  EXPECT_EQ(rays.statistics().triangles, 0u);
}

TEST(RayScene, SurfaceOfATexturedQuad) {
  const RayScene rays(texturedQuad());
  const Surface s = hitSurface(rays, vec3(0.5f, 0.25f, 3.0f), vec3(0, 0, -1));
  expectNear(s.position, vec3(0.5f, 0.25f, 0.0f));
  expectNear(s.geometricNormal, vec3(0, 0, 1));
  expectNear(s.shadingNormal, vec3(0, 0, 1));
  expectNear(s.tangent, vec3(1, 0, 0));
  expectNear(s.bitangent, vec3(0, 1, 0));
  EXPECT_NEAR(s.texCoords[0].x, 0.75f, 1e-4f);
  EXPECT_NEAR(s.texCoords[0].y, 0.375f, 1e-4f);
  EXPECT_EQ(s.color, vec4(1.0f));
  for (const vec3& away : {vec3(0, 0, 1), vec3(0, 0, -1), vec3(1, 0, 1e-7f), vec3(1, 0, 0)})
    EXPECT_FALSE(rays.occluded(s.leave(), away, 0.0f, kInfinity)) << away.z;
}

TEST(RayScene, TextureCoordinatesOnlyWhereAMaterialHasATexture) {
  Scene scene = texturedQuad();
  scene.materials[0].normalTexture.image = kNone;
  const RayScene rays(scene);
  const Surface s = hitSurface(rays, vec3(0.5f, 0.25f, 3.0f), vec3(0, 0, -1));
  EXPECT_EQ(s.texCoords[0], vec2(0.0f));
  EXPECT_EQ(s.tangent, vec3(0.0f));
}

TEST(RayScene, ASecondSetOfTexCoordsWhereAMaterialReadsIt) {
  Scene scene = texturedQuad();
  for (const vec2& uv : scene.meshes[0].texCoords) {
    scene.meshes[0].secondTexCoords.emplace_back(3.0f * uv.y, uv.x - 1.0f);
  }
  const auto surface = [&] {
    return hitSurface(RayScene(scene), vec3(0.5f, 0.25f, 3.0f), vec3(0, 0, -1));
  };
  EXPECT_EQ(surface().texCoords[1], vec2(0.0f));
  scene.materials[0].emissiveTexture = {.image = 0, .set = 1};
  const Surface s = surface();
  EXPECT_NEAR(s.texCoords[0].x, 0.75f, 1e-4f);
  EXPECT_NEAR(s.texCoords[1].x, 3.0f * 0.375f, 1e-4f);
  EXPECT_NEAR(s.texCoords[1].y, -0.25f, 1e-4f);
  expectNear(s.tangent, vec3(1, 0, 0));  // along the first set
  expectNear(s.bitangent, vec3(0, 1, 0));
}

TEST(RayScene, MirroredPlacementsKeepTheFrontMergedAndInstanced) {
  for (std::uint64_t merge : {std::uint64_t{0}, std::uint64_t{1} << 20}) {
    Scene scene = texturedQuad();
    scene.instances[0].transform[0][0] = -1.0;
    scene.instances[0].object = 5;
    scene.instances.push_back(scene.instances[0]);
    scene.instances[1].transform[3] = glm::dvec4(10.0, 0.0, 0.0, 1.0);
    RayScene::Options options;
    options.mergeTriangles = merge;
    const RayScene rays(scene, options);
    EXPECT_EQ(rays.statistics().instances, merge ? 0u : 2u);
    EXPECT_EQ(rays.statistics().triangles, 4u);
    const vec3 o(dvec3(0.5, 0.25, 3.0) - rays.renderOrigin());
    const Surface s = hitSurface(rays, o, vec3(0, 0, -1));
    expectNear(s.geometricNormal, vec3(0, 0, 1));
    expectNear(s.tangent, vec3(-1, 0, 0));
    expectNear(s.bitangent, vec3(0, 1, 0));
    EXPECT_NEAR(s.texCoords[0].x, 0.25f, 1e-4f);
    EXPECT_EQ(s.object, 5u);
  }
}

TEST(RayScene, InstancedAndMergedScenesAreTheSame) {
  Scene scene = bench::sceneOf(bench::bumpySphere(12, true));
  scene.instances[0].transform[1][1] = 0.5;
  for (int i = 1; i < 5; ++i) {
    scene.instances.push_back(scene.instances[0]);
    scene.instances.back().transform[3] = glm::dvec4(1.5 * i, 0.3 * i, 0.0, 1.0);
    scene.instances.back().transform[0][1] = 0.3;
  }
  RayScene::Options merged;
  merged.mergeTriangles = 1u << 30;
  RayScene::Options instanced;
  instanced.mergeTriangles = 0;
  const RayScene a(scene, merged), b(scene, instanced);
  EXPECT_EQ(a.statistics().triangles, b.statistics().triangles);
  EXPECT_EQ(b.statistics().uniqueTriangles * 5, b.statistics().triangles);
  int hits = 0;
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const vec3 o(8.0f * (bench::uniform(6 * i) - 0.5f), 4.0f * (bench::uniform(6 * i + 1) - 0.5f),
                 6.0f);
    const vec3 d = glm::normalize(
        vec3(bench::uniform(6 * i + 2) - 0.5f, bench::uniform(6 * i + 3) - 0.5f, -2.0f));
    RayHit x, y;
    const bool found = a.intersect(o, d, 0.0f, kInfinity, x);
    // Silhouettes may differ by rounding.
    if (found != b.intersect(o, d, 0.0f, kInfinity, y)) continue;
    if (!found) continue;
    ++hits;
    if (std::abs(x.t - y.t) > 1e-4f) continue;
    const Surface s = a.surface(x), r = b.surface(y);
    EXPECT_LT(glm::length(s.position - r.position), 1e-4f);
    EXPECT_LT(glm::length(s.shadingNormal - r.shadingNormal), 0.05f);
  }
  EXPECT_GT(hits, 3000);
}

// Merged, and under Embree; some rays start far outside, some never meet the scene, a plane cuts
// it.
TEST(RayScene, SpansOfRaysGiveTheAnswersOfSingleRays) {
  Scene scene = bench::sceneOf(bench::bumpySphere(20, false));
  for (int instances = 1; instances <= 2; ++instances) {
    RayScene rays(scene, {.mergeTriangles = 0});
    Visibility cut;
    cut.cut = true, cut.normal = vec3(0.0f, 0.0f, 1.0f), cut.offset = 0.3f;
    rays.setVisibility(cut);
    std::vector<RayQuery> queries;
    for (std::uint32_t i = 0; i < 700; ++i) {
      const dvec3 from = i % 5 == 0   ? dvec3(0.0, 0.0, 1e9)
                         : i % 7 == 0 ? dvec3(0.0, 9.0, 0.0)
                                      : dvec3(0.1, 0.2, 0.0);
      const vec3 d(bench::uniform(3 * i) - 0.5f, bench::uniform(3 * i + 1) - 0.5f,
                   bench::uniform(3 * i + 2) * 0.3f - 1.0f);
      queries.push_back(
          {from - rays.renderOrigin(), glm::normalize(d), 0.0f, i % 3 ? kInfinity : 0.9f});
    }
    std::vector<RayHit> hits(queries.size());
    std::vector<std::uint8_t> met(queries.size(), 7), blocked(queries.size(), 7);
    rays.intersect(queries, hits, met);
    rays.occluded(queries, blocked);
    int found = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      const RayQuery& q = queries[i];
      RayHit hit;
      const bool one = rays.intersect(q.start, q.direction, q.tnear, q.end, hit);
      found += one;
      ASSERT_EQ(met[i], one ? 1 : 0);
      EXPECT_EQ(blocked[i], rays.occluded(q.start, q.direction, q.tnear, q.end) ? 1 : 0);
      if (!one) continue;
      EXPECT_EQ(hits[i].t, hit.t);
      EXPECT_EQ(hits[i].u, hit.u);
      EXPECT_EQ(hits[i].v, hit.v);
      EXPECT_EQ(hits[i].instance, hit.instance);
      EXPECT_EQ(hits[i].cluster, hit.cluster);
      EXPECT_EQ(hits[i].triangle, hit.triangle);
    }
    EXPECT_GT(found, 200);
    scene.instances.push_back(scene.instances[0]);
    scene.instances.back().transform = moved({3.0, 0.0, 0.0});
  }
}

TEST(RayScene, RaysLeaveTheSurfaceInEveryDirection) {
  for (const dvec3& place : {dvec3(0.0), dvec3(5e6, 0.0, 5e6)})
    for (int copies : {1, 2}) {
      Scene scene = bench::sceneOf(bench::bumpySphere(40, false));
      scene.instances[0].transform = moved(place);
      if (copies == 2) {
        scene.instances.push_back(scene.instances[0]);
        scene.instances[1].transform[3] += glm::dvec4(300.0, 0.0, 0.0, 0.0);
      }
      const RayScene rays(scene);
      const vec3 centre(place - rays.renderOrigin());
      int hits = 0;
      for (std::uint64_t i = 0; i < 100000; ++i) {
        const vec3 toward(bench::uniform(5 * i) - 0.5f, bench::uniform(5 * i + 1) - 0.5f,
                          bench::uniform(5 * i + 2) - 0.5f);
        RayHit hit, again;
        ASSERT_TRUE(rays.intersect(centre, glm::normalize(toward), 0.0f, kInfinity, hit));
        const Surface s = rays.surface(hit);
        // Along the outer side: down to grazing directions.
        const float z = std::pow(bench::uniform(5 * i + 3), 4.0f),
                    phi = 6.2831853f * bench::uniform(5 * i + 4);
        const float r = std::sqrt(std::max(0.0f, 1.0f - z * z));
        const vec3 d =
            Basis(s.geometricNormal).toWorld(vec3(r * std::cos(phi), r * std::sin(phi), z));
        if (!rays.intersect(s.leave(), d, 0.0f, kInfinity, again)) continue;
        hits += again.cluster == hit.cluster && again.triangle == hit.triangle;
      }
      EXPECT_EQ(hits, 0);
    }
}

TEST(RayScene, FlatAndWildTransformsDoNotHarm) {
  Scene scene = bench::sceneOf(bench::bumpySphere(12, false));
  scene.instances[0].transform[2][2] = 0.0;
  scene.instances.push_back(scene.instances[0]);
  scene.instances[1].transform = moved({5.0, 0.0, 0.0});
  scene.instances.push_back(scene.instances[1]);
  scene.instances[2].transform = dmat4(0.0);
  RayScene::Options options;
  options.mergeTriangles = 0;
  const RayScene rays(scene, options);
  const vec3 o(dvec3(0.0, 0.0, 4.0) - rays.renderOrigin());
  const Surface s = hitSurface(rays, o, vec3(0, 0, -1));
  EXPECT_NEAR(s.position.z + rays.renderOrigin().z, 0.0, 1e-5);
  EXPECT_NEAR(std::abs(s.geometricNormal.z), 1.0f, 1e-4f);
}

TEST(RayScene, TriangleWithoutAreaHasAUnitNormal) {
  Mesh m;
  m.positions = {{0, 0, 0}, {1, 1, 0}, {2, 2, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
  m.triangles = {{0, 1, 2}, {3, 4, 5}};
  const RayScene rays(bench::sceneOf(m));
  for (std::uint32_t c = 0; c < 1; ++c)
    for (std::uint32_t t = 0; t < 2; ++t) {
      const Surface s = rays.surface({1.0f, 0.2f, 0.3f, RayScene::kWorldMesh, c, t});
      EXPECT_NEAR(glm::length(s.geometricNormal), 1.0f, 1e-5f);
      EXPECT_NEAR(glm::length(s.shadingNormal), 1.0f, 1e-5f);
    }
}

// Objects of a triangle each are leaves of a triangle each, which take most when expanded.
TEST(RayScene, ExpandedCopiesAreBoundedInBytes) {
  const auto topLevelBytes = [](std::uint64_t count) {
    Scene scene;
    scene.materials.resize(1);
    for (std::uint64_t i = 0; i < count; ++i) {
      const vec3 at(static_cast<float>(i % 400), 0.0f, static_cast<float>(i / 400));
      Mesh mesh;
      mesh.material = 0;
      mesh.positions = {at, at + vec3(0.9f, 0.0f, 0.0f), at + vec3(0.0f, 0.0f, 0.9f)};
      mesh.triangles = {{0, 1, 2}};
      Instance instance;
      instance.mesh = instance.object = static_cast<int>(i);
      scene.meshes.push_back(std::move(mesh));
      scene.instances.push_back(instance);
    }
    return RayScene(scene).statistics().topLevelBytes;
  };
  EXPECT_GT(topLevelBytes(1000), 320u * 1000u);
  EXPECT_LT(topLevelBytes(RayScene::kExpandedLeaves + 1000), std::uint64_t{16} << 20);
}

TEST(RayScene, VertexNormalsAndColoursAreInterpolated) {
  Mesh m = quad();
  m.normals = {{0, 0, 1}, {0.6f, 0, 0.8f}, {0.6f, 0, 0.8f}, {0, 0, 1}};
  m.colors = {{255, 0, 0, 255}, {0, 255, 0, 255}, {0, 255, 0, 255}, {255, 0, 0, 255}};
  const RayScene rays(bench::sceneOf(m));
  const Surface right = hitSurface(rays, vec3(0.999f, 0.0f, 1.0f), vec3(0, 0, -1));
  expectNear(right.shadingNormal, vec3(0.6f, 0.0f, 0.8f), 2e-3f);
  expectNear(vec3(right.color), vec3(0, 1, 0), 2e-3f);
  const Surface below = hitSurface(rays, vec3(-0.999f, 0.0f, -1.0f), vec3(0, 0, 1));
  expectNear(below.geometricNormal, vec3(0, 0, 1));
}
