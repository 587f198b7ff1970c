// Plain surfaces in lanes are what makeSurface() and Bsdf make of them one at a time, bit for bit.
#include "src/crays/plain_lanes.h"

#include <gtest/gtest.h>

#include <hwy/highway.h>
#include <cstring>
#include <vector>

#include "src/crays/bsdf.h"
#include "src/crays/ray_scene_surface.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

/// One of eight: what a ray met, and what it met it with.
struct Met {
  hccm::Triangle triangle{};
  RayHit hit;
  vec3 direction{0.0f};
  Sampler numbers{0, 0, 0};
};

vec3 randomDirection(Sampler& sampler) {
  const vec2 u = sampler.next2D();
  const float z = 2.0f * u.x - 1.0f, r = std::sqrt(std::max(0.0f, 1.0f - z * z));
  return {r * std::cos(2.0f * kPi * u.y), r * std::sin(2.0f * kPi * u.y), z};
}

/// Corners on a coarse grid, so that edges along the axes and equal corners turn up; normals around
/// the triangle's own, some far off, some zero.
Met randomHit(std::uint32_t number) {
  Sampler sampler(number, 0, 3);
  Met met;
  hccm::Triangle& t = met.triangle;
  for (vec3& p : t.position) {
    const vec2 a = sampler.next2D(), b = sampler.next2D();
    p = glm::floor(vec3(a.x, a.y, b.x) * 12.0f) * (b.y < 0.5f ? 0.25f : 64.0f) - 1.0f;
  }
  t.hasNormals = sampler.next1D() < 0.6f;
  const vec3 across = glm::cross(t.position[1] - t.position[0], t.position[2] - t.position[0]);
  const float spread = sampler.next1D() < 0.8f ? 0.3f : 2.0f;
  for (vec3& n : t.normal) {
    n = glm::normalize(across + 1e-6f) + spread * randomDirection(sampler);
    n = sampler.next1D() < 0.02f ? vec3(0.0f) : glm::normalize(n);
  }
  const vec2 u = sampler.next2D();
  met.hit.u = double(u.x) * (1.0 - double(u.y));
  met.hit.v = double(u.x) * double(u.y);
  met.direction = randomDirection(sampler);
  if (sampler.next1D() < 0.2f) {  // grazes
    const vec3 flat = met.direction - glm::normalize(across + 1e-6f) *
                                          glm::dot(met.direction, glm::normalize(across + 1e-6f));
    met.direction = glm::normalize(flat + 1e-4f * met.direction);
  }
  met.numbers = Sampler(number, 1, 3);
  return met;
}

std::vector<Material> materials() {
  std::vector<Material> all{test::lambert(0.7f), test::lambert(0.0f)};
  for (float metallic : {0.0f, 0.4f, 1.0f}) {
    for (float roughness : {0.11f, 0.5f, 1.0f}) {
      Material m;
      m.baseColor = vec4(0.9f, 0.5f, 0.0f, 1.0f);
      m.metallic = metallic;
      m.roughness = roughness;
      m.specularColor = vec3(1.0f, 0.8f, 0.5f);
      all.push_back(m);
    }
  }
  return all;
}

template <typename T>
bool same(const T& a, const T& b) {
  return std::memcmp(&a, &b, sizeof(T)) == 0;
}

void set(PlainLanes& lanes, std::size_t lane, const Met& met, const PlainMaterial& m) {
  lanes.u[lane] = met.hit.u;
  lanes.v[lane] = met.hit.v;
  if (met.triangle.hasNormals) lanes.smooth |= 1u << lane;
  for (int k = 0; k < 3; ++k) {
    for (int corner = 0; corner < 3; ++corner) {
      lanes.corner[corner][k][lane] = met.triangle.position[corner][k];
      lanes.cornerNormal[corner][k][lane] = met.triangle.normal[corner][k];
    }
    lanes.direction[k][lane] = met.direction[k];
    lanes.color[k][lane] = m.color[k];
    lanes.f0[k][lane] = m.f0[k];
  }
  lanes.f90[lane] = m.f90;
  lanes.metallic[lane] = m.metallic;
  lanes.alpha[lane] = m.alpha;
}

void expectSame(const PlainLanes& lanes, std::size_t lane, const Surface& surface,
                const Bsdf& bsdf) {
  const auto at = [lane](const auto& of) { return PlainLanes::vector(of, lane); };
  EXPECT_TRUE(same(at(lanes.position), surface.position));
  EXPECT_TRUE(same(at(lanes.geometricNormal), surface.geometricNormal));
  EXPECT_TRUE(same(at(lanes.lift[0]), surface.lift[0]));
  EXPECT_TRUE(same(at(lanes.lift[1]), surface.lift[1]));
  EXPECT_TRUE(same(lanes.bend[lane], surface.bend));
  EXPECT_TRUE(same(at(lanes.facing), bsdf.geometricNormal()));
  EXPECT_TRUE(same(at(lanes.normal), bsdf.normal()));
  EXPECT_EQ(bsdf.cacheable(), lanes.specularLobe[lane] * lanes.metallic[lane] <= Bsdf::kMostSharp);
  if (!PlainLanes::is(lanes.lambertian, lane)) return;
  EXPECT_EQ(bsdf.albedo(), glm::min(at(lanes.diffuse), vec3(1.0f)));
}

/// All that is asked of eight surfaces of a scene's materials. Returns how many lanes were plain.
int compare(const Scene& scene, const std::vector<PlainMaterial>& plain, std::uint32_t first) {
  const PlainKernels& kernels = *choosePlainKernels();
  Met met[PlainLanes::kLanes];
  PlainLanes lanes{};
  PlainValues values{};
  PlainSamples samples{};
  std::vector<Surface> surfaces;
  std::vector<Bsdf> bsdfs;
  for (std::uint32_t lane = 0; lane < PlainLanes::kLanes; ++lane) {
    const std::uint32_t material = hash32(first + lane) % static_cast<std::uint32_t>(plain.size());
    met[lane] = randomHit(first + lane);
    met[lane].triangle.material = material;
    set(lanes, lane, met[lane], plain[material]);
    surfaces.push_back(makeSurface(met[lane].triangle, Placement(), met[lane].hit));
    bsdfs.emplace_back(scene, surfaces.back(), -met[lane].direction);
    Sampler numbers = met[lane].numbers;
    samples.choice[lane] = numbers.next1D();
    const vec2 u = numbers.next2D();
    samples.u[lane] = u.x, samples.v[lane] = u.y;
    const vec3 incoming = randomDirection(numbers);
    for (int k = 0; k < 3; ++k) values.direction[k][lane] = incoming[k];
  }
  kernels.shade(lanes);
  kernels.value(lanes, values);
  kernels.sample(lanes, samples);
  int count = 0;
  for (std::uint32_t lane = 0; lane < PlainLanes::kLanes; ++lane) {
    if (PlainLanes::is(lanes.odd, lane)) continue;
    SCOPED_TRACE(first + lane);
    ++count;
    expectSame(lanes, lane, surfaces[lane], bsdfs[lane]);
    const vec3 incoming = PlainLanes::vector(values.direction, lane);
    const BsdfValue value = bsdfs[lane].value(incoming);
    EXPECT_EQ(PlainLanes::vector(values.f, lane), value.f);
    EXPECT_EQ(values.pdf[lane], value.pdf);
    EXPECT_EQ(lanes.leavesFront(incoming, lane), bsdfs[lane].leavesFront(incoming));
    BsdfSample next;
    const bool found = bsdfs[lane].sample(met[lane].numbers, next);
    EXPECT_EQ(PlainLanes::is(samples.found, lane), found);
    if (!found) continue;
    EXPECT_TRUE(same(PlainLanes::vector(samples.direction, lane), next.direction));
    EXPECT_EQ(PlainLanes::vector(samples.weight, lane), next.weight);
    EXPECT_TRUE(
        same(lanes.photonFactor(next.direction, lane), bsdfs[lane].photonFactor(next.direction)));
    EXPECT_EQ(samples.pdf[lane], next.pdf);
    EXPECT_EQ(samples.roughness[lane], next.roughness);
  }
  return count;
}

TEST(PlainLanes, AreSurfacesAndBsdfsBitForBitOnEveryInstructionSet) {
  Scene scene;
  scene.materials = materials();
  const std::vector<PlainMaterial> plain = plainMaterials(scene.materials);
  for (const PlainMaterial& m : plain) EXPECT_TRUE(m.plain);
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    int count = 0;
    for (std::uint32_t first = 0; first < 16000; first += PlainLanes::kLanes) {
      count += compare(scene, plain, first);
      if (HasFailure()) break;
    }
    EXPECT_GT(count, 14000);  // few triangles have no area
    hwy::SetSupportedTargetsForTest(0);
    if (HasFailure()) return;
  }
}

/// What a material needs to be plain.
TEST(PlainLanes, LeaveOutWhatTheyDoNotKnow) {
  std::vector<Material> all(9);
  all[0].roughness = 0.1f;  // shows what is around
  all[1].transmission = 0.5f;
  all[2].alphaMode = AlphaMode::kBlend;
  all[3].emission = vec3(1.0f);
  all[4].finish.clearcoat = 0.5f;
  all[5].unlit = true;
  all[6].normalTexture.image = 0;
  all[7].specularTexture.image = 0;
  all[8].specularColorTexture.image = 0;
  for (const PlainMaterial& m : plainMaterials(all)) EXPECT_FALSE(m.plain);
}

}  // namespace
}  // namespace trex
