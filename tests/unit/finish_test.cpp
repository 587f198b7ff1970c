#include "src/crays/finish.h"

#include <gtest/gtest.h>

#include "src/crays/bsdf.h"
#include "src/crays/microfacet.h"
#include "src/scene/fresnel.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

Surface flat() {
  Surface s{};
  s.geometricNormal = s.shadingNormal = vec3(0.0f, 0.0f, 1.0f);
  s.tangent = vec3(1.0f, 0.0f, 0.0f), s.bitangent = vec3(0.0f, 1.0f, 0.0f);
  s.color = vec4(1.0f);
  return s;
}

vec3 towards(float cosine) { return {std::sqrt(1.0f - cosine * cosine), 0.0f, cosine}; }

/// What a material sends back of light from everywhere.
double albedo(const Material& m, float cosine) {
  Scene scene;
  scene.materials = {m};
  const Surface s = flat();
  const Bsdf b(scene, s, towards(cosine));
  double sum = 0.0;
  constexpr std::uint32_t kCount = 60000;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(i, 0, 5);
    BsdfSample sample;
    if (b.sample(sampler, sample)) sum += double(sample.weight.y) / kCount;
  }
  return sum;
}

/// White under any finish stays as white as the layers let it.
TEST(Finish, AWhiteSurfaceMakesNoLightAndLosesLittle) {
  for (const float cosine : {1.0f, 0.6f, 0.2f}) {
    for (const float roughness : {0.0f, 0.3f, 0.8f}) {
      Material coated = test::lambert(1.0f);
      coated.finish.clearcoat = 1.0f;
      coated.finish.clearcoatRoughness = roughness;
      EXPECT_LT(albedo(coated, cosine), 1.005) << cosine << " " << roughness;
      // Shaded as a smooth coat shades, of which a rough one sends back less at grazing angles.
      EXPECT_GT(albedo(coated, cosine), roughness > 0.5f ? 0.65 : 0.87)
          << cosine << " " << roughness;
      Material cloth = test::lambert(1.0f);
      cloth.finish.sheenColor = vec3(1.0f);
      cloth.finish.sheenRoughness = roughness;
      EXPECT_LT(albedo(cloth, cosine), 1.01) << cosine << " " << roughness;
      EXPECT_GT(albedo(cloth, cosine), 0.8) << cosine << " " << roughness;
    }
  }
}

TEST(Finish, ACoatOnBlackReflectsAsFresnelSays) {
  Material m = test::lambert(0.0f);
  m.finish.clearcoat = 0.5f;
  for (const float cosine : {1.0f, 0.5f, 0.1f}) {
    EXPECT_NEAR(albedo(m, cosine), 0.5 * (0.04 + 0.96 * std::pow(1.0 - cosine, 5.0)), 1e-4);
  }
}

TEST(Finish, MetalsReflectByTheirIndex) {
  constexpr float kEta[] = {0.0f, 0.2f, 1.0f, 2.9f, 1e4f}, kK[] = {0.0f, 0.01f, 3.0f, 1e4f};
  for (const float eta : kEta) {
    for (const float k : kK) {
      for (const float cosine : {0.0f, 0.01f, 0.3f, 0.9f, 1.0f}) {
        const double right = detail::fresnelReflectance(double(cosine), {eta, k});
        const float found = conductorReflectance(cosine, vec3(eta), vec3(k)).y;
        ASSERT_TRUE(found >= 0.0f && found <= 1.0f) << eta << " " << k << " " << cosine;
        if (eta * k == 0.0f) continue;  // an index that no metal has
        EXPECT_NEAR(found, right, 2e-4) << eta << " " << k << " " << cosine;
      }
    }
  }
  Material smooth;
  smooth.roughness = 0.0f;
  detail::setMetal({vec3(1.5f), vec3(2.0f)}, smooth);
  smooth.baseColor = vec4(0.5f, 0.5f, 0.5f, 1.0f);  // takes its share
  for (const float cosine : {1.0f, 0.5f, 0.1f}) {
    EXPECT_NEAR(albedo(smooth, cosine),
                0.5 * detail::fresnelReflectance(double(cosine), {1.5, 2.0}), 1e-4);
  }
}

TEST(Finish, BeckmannIsNormalisedAndItsTailsAreShort) {
  for (const float alpha : {0.05f, 0.25f, 0.7f}) {
    double sum = 0.0;
    constexpr int kSteps = 20000;
    for (int i = 0; i < kSteps; ++i) {
      const double c = (i + 0.5) / kSteps;
      sum += double(beckmannDensity(float(c), alpha)) * c * 2.0 * std::numbers::pi / kSteps;
    }
    EXPECT_NEAR(sum, 1.0, 1e-3) << alpha;
    EXPECT_LT(beckmannDensity(0.5f, 0.25f), 1e-3f * ggxDensity(0.5f, 0.25f));
  }
  Material m;
  m.roughness = 0.5f;
  m.finish.beckmann = true;
  EXPECT_NEAR(albedo(m, 0.9f), 1.0, 0.01);
}

TEST(Finish, SheensTableIsItsIntegral) {
  for (const float alpha : {0.02f, 0.25f, 0.7f, 1.0f}) {
    for (const float cosine : {0.05f, 0.3f, 0.8f, 1.0f}) {
      const vec3 out = towards(cosine);
      double sum = 0.0;
      constexpr int kHeights = 400, kTurns = 200;
      for (int i = 0; i < kHeights; ++i) {
        const float h = (static_cast<float>(i) + 0.5f) / kHeights, z = h * h;
        for (int j = 0; j < kTurns; ++j) {
          const float phi = 2.0f * kPi * (static_cast<float>(j) + 0.5f) / kTurns;
          const float r = std::sqrt(1.0f - z * z);
          const vec3 in(r * std::cos(phi), r * std::sin(phi), z);
          sum += double(sheenReflection(out, in, alpha)) * 4.0 * std::numbers::pi * h /
                 (kHeights * kTurns);
        }
      }
      EXPECT_NEAR(sheenAlbedo(cosine, alpha), std::min(sum, 1.0), 0.015) << cosine << " " << alpha;
    }
  }
}

/// Brushed along x: light from the side is spread along x.
TEST(Finish, AnisotropyIsRougherAlongItsDirection) {
  Scene scene;
  Material metal;
  metal.roughness = 0.2f;
  metal.finish.anisotropy = 0.9f;
  Material across = metal;
  across.finish.anisotropyRotation = 0.5f * kPi;
  scene.materials = {metal, across};
  Surface s = flat();
  const float tilt = 0.4f;
  const vec3 alongX = glm::normalize(vec3(tilt, 0.0f, 1.0f)),
             alongY = glm::normalize(vec3(0.0f, tilt, 1.0f)), up(0.0f, 0.0f, 1.0f);
  const Bsdf b(scene, s, up);
  EXPECT_GT(b.evaluate(alongX).x, 20.0f * b.evaluate(alongY).x);
  s.material = 1;
  const Bsdf turned(scene, s, up);
  EXPECT_NEAR(turned.evaluate(alongY).x / b.evaluate(alongX).x, 1.0f, 1e-3f);
}

/// Over all thicknesses the interference goes: Airy's sum of what is reflected to and fro.
TEST(Finish, AFilmsMeanIsThatOfIncoherentReflections) {
  constexpr float kIndex = 1.33f, kBase = 0.3f;
  const float root = std::sqrt(kBase), index = (1.0f + root) / (1.0f - root);
  const auto reflected = [](float a, float b) { return (a - b) * (a - b) / ((a + b) * (a + b)); };
  const float upper = reflected(1.0f, kIndex), lower = reflected(kIndex, index);
  const float right = upper + (1.0f - upper) * (1.0f - upper) * lower / (1.0f - upper * lower);
  vec3 sum(0.0f), least(1.0f), most(0.0f);
  constexpr int kSteps = 4000;
  for (int i = 0; i < kSteps; ++i) {
    const vec3 r =
        filmReflectance(1.0f, kIndex, 100.0f + 0.5f * static_cast<float>(i), vec3(kBase));
    sum += r / float(kSteps);
    least = glm::min(least, r), most = glm::max(most, r);
  }
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(sum[k] / right, 1.0f, 0.02f) << k;
    EXPECT_GT(most[k] - least[k], 0.1f) << k;
  }
  EXPECT_EQ(filmReflectance(0.0f, 1.3f, 300.0f, vec3(0.04f)), vec3(1.0f));
}

/// A film without thickness is not there.
TEST(Finish, AFilmOfNoThicknessIsBare) {
  for (const float f0 : {0.04f, 0.5f, 0.95f}) {
    EXPECT_NEAR(filmReflectance(1.0f, 1.6f, 0.0f, vec3(f0)).y, f0, 0.02f);
  }
}

}  // namespace
}  // namespace trex
