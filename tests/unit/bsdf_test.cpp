#include "src/crays/bsdf.h"

#include <gtest/gtest.h>

#include <vector>

#include "src/crays/lights_detail.h"
#include "src/crays/microfacet.h"
#include "tests/unit/chi_square.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

struct Case {
  const char* name;
  Material material;
  float cosine;  // of the outgoing direction
};

Material glossy(float metallic, float roughness, float transmission, bool volume) {
  Material m;
  m.baseColor = vec4(0.8f, 0.6f, 0.4f, 1.0f);
  m.metallic = metallic;
  m.roughness = roughness;
  m.transmission = transmission;
  m.volume = volume;
  return m;
}

Material coated(Material m, float weight, float roughness) {
  m.finish.clearcoat = weight;
  m.finish.clearcoatRoughness = roughness;
  return m;
}

Material cloth(const vec3& color, float roughness) {
  Material m = test::lambert(0.8f);
  m.finish.sheenColor = color;
  m.finish.sheenRoughness = roughness;
  return m;
}

Material dulled(Material glass) {
  glass.specular = 0.5f;
  glass.specularColor = vec3(0.2f, 1.0f, 1.5f);
  return glass;
}

Material brushed(float strength, float rotation) {
  Material m = glossy(1.0f, 0.3f, 0.0f, false);
  m.finish.anisotropy = strength;
  m.finish.anisotropyRotation = rotation;
  return m;
}

Material ofIndex(float roughness, bool beckmann) {
  Material m = glossy(1.0f, roughness, 0.0f, false);
  m.finish.metalEta = vec3(1.7f, 0.9f, 0.5f);
  m.finish.metalK = vec3(9.2f, 6.3f, 4.8f);
  m.finish.beckmann = beckmann;
  return m;
}

Material beckmann(Material m) {
  m.finish.beckmann = true;
  return m;
}

Material filmed(float share, float ior) {
  Material m = glossy(0.0f, 0.4f, 0.0f, false);
  m.finish.iridescence = share;
  m.finish.iridescenceIor = ior;
  return m;
}

std::vector<Case> cases() {
  return {{"lambert", test::lambert(0.8f), 0.7f},
          {"lambertGrazing", test::lambert(0.8f), 0.05f},
          {"metalRough", glossy(1.0f, 0.6f, 0.0f, false), 0.7f},
          {"metalSharpGrazing", glossy(1.0f, 0.25f, 0.0f, false), 0.2f},
          {"plastic", glossy(0.0f, 0.4f, 0.0f, false), 0.6f},
          {"mixed", glossy(0.5f, 0.5f, 0.0f, false), 0.4f},
          {"frostedThin", glossy(0.0f, 0.4f, 1.0f, false), 0.8f},
          {"frostedSolid", glossy(0.0f, 0.4f, 1.0f, true), 0.8f},
          {"halfTransmission", glossy(0.0f, 0.5f, 0.5f, true), 0.5f},
          {"dulledThin", dulled(glossy(0.0f, 0.4f, 1.0f, false)), 0.8f},
          {"dulledSolid", dulled(glossy(0.0f, 0.4f, 1.0f, true)), 0.5f},
          {"coatedMetal", coated(glossy(1.0f, 0.6f, 0.0f, false), 1.0f, 0.3f), 0.3f},
          {"coatedFrosted", coated(glossy(0.0f, 0.4f, 1.0f, false), 0.7f, 0.4f), 0.5f},
          {"cloth", cloth(vec3(0.9f, 0.5f, 0.2f), 0.5f), 0.4f},
          {"coatedCloth", coated(cloth(vec3(0.5f), 0.9f), 1.0f, 0.5f), 0.6f},
          {"brushed", brushed(0.8f, 0.5f), 0.5f},
          {"aluminium", ofIndex(0.5f, false), 0.3f},
          {"beckmannMetal", ofIndex(0.5f, true), 0.3f},
          {"beckmannPlastic", beckmann(glossy(0.0f, 0.6f, 0.0f, false)), 0.6f},
          {"beckmannThin", beckmann(glossy(0.0f, 0.4f, 1.0f, false)), 0.8f},
          {"beckmannSolid", beckmann(glossy(0.0f, 0.4f, 1.0f, true)), 0.8f},
          {"soapy", filmed(1.0f, 1.4f), 0.7f}};
}

Surface surfaceAtOrigin() {
  Surface s{};
  s.geometricNormal = s.shadingNormal = glm::normalize(vec3(0.3f, -0.5f, 0.8f));
  s.color = vec4(1.0f);
  const Basis basis(s.geometricNormal);
  s.tangent = basis.tangent, s.bitangent = basis.bitangent;
  return s;
}

vec3 outgoing(const Surface& s, float cosine) {
  return Basis(s.geometricNormal)
      .toWorld(vec3(std::sqrt(1.0f - cosine * cosine) * 0.6f,
                    std::sqrt(1.0f - cosine * cosine) * 0.8f, cosine));
}

class BsdfTest : public ::testing::TestWithParam<Case> {
 protected:
  BsdfTest() {
    scene_.materials = {GetParam().material};
    surface_ = surfaceAtOrigin();
  }
  Bsdf bsdf() const { return {scene_, surface_, outgoing(surface_, GetParam().cosine)}; }
  Scene scene_;
  Surface surface_;
};

/// Histogram of sampled directions against the integral of pdf() over each cell of the sphere.
TEST_P(BsdfTest, SamplesFollowTheirDensity) {
  constexpr int kTheta = 24, kPhi = 48, kCount = 400000, kFine = 12;
  const Bsdf b = bsdf();
  std::vector<double> counts(kTheta * kPhi, 0.0), expected(kTheta * kPhi, 0.0);
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(i, 0, 9);
    BsdfSample s;
    if (!b.sample(sampler, s)) continue;
    ASSERT_FALSE(s.delta);
    EXPECT_NEAR(glm::length(s.direction), 1.0f, 1e-4f);
    const vec3 d = Basis(surface_.geometricNormal).toLocal(s.direction);
    const double z = std::clamp(0.5 * (1.0 + static_cast<double>(d.z)), 0.0, 0.999999);
    const double phi = std::atan2(d.y, d.x) / (2.0 * std::numbers::pi) + 0.5;
    const auto cell = static_cast<std::size_t>(z * kTheta) * kPhi +
                      static_cast<std::size_t>(std::min(phi, 0.999999) * kPhi);
    counts[cell] += 1.0;
  }
  for (int i = 0; i < kTheta * kFine; ++i) {
    for (int j = 0; j < kPhi * kFine; ++j) {
      const double z = 2.0 * (i + 0.5) / (kTheta * kFine) - 1.0;
      const double phi = 2.0 * std::numbers::pi * ((j + 0.5) / (kPhi * kFine) - 0.5);
      const double r = std::sqrt(1.0 - z * z);
      const vec3 d(static_cast<float>(r * std::cos(phi)), static_cast<float>(r * std::sin(phi)),
                   static_cast<float>(z));
      const double density = b.pdf(Basis(surface_.geometricNormal).toWorld(d));
      expected[static_cast<std::size_t>(i / kFine * kPhi + j / kFine)] +=
          density * kCount * 4.0 * std::numbers::pi / (kTheta * kFine * kPhi * kFine);
    }
  }
  EXPECT_GT(test::chiSquareP(counts, expected), 1e-3) << GetParam().name;
}

/// weight = f cos / pdf, and no material reflects more than arrives.
TEST_P(BsdfTest, WeightIsConsistentAndEnergyIsNotMade) {
  const Bsdf b = bsdf();
  double energy = 0.0;
  constexpr int kCount = 100000;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(i, 0, 3);
    BsdfSample s;
    if (!b.sample(sampler, s)) continue;
    const vec3 expected = b.evaluate(s.direction) / b.pdf(s.direction);
    EXPECT_NEAR(s.weight.x, expected.x, 2e-3f * (1.0f + expected.x));
    EXPECT_NEAR(s.pdf / b.pdf(s.direction), 1.0f, 2e-3f);
    energy += static_cast<double>(s.weight.x * s.etaSquared) / kCount;
  }
  EXPECT_LT(energy, 1.01);
  EXPECT_GT(energy, 0.3);
}

/// Both at once are the bits of each, to all sides and for each kind of lobe.
TEST_P(BsdfTest, ValueIsThatOfEvaluateAndPdf) {
  const Bsdf b = bsdf();
  int reached = 0;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    Sampler sampler(i, 0, 11);
    const vec3 direction = uniformSphere(sampler.next2D());
    for (const LobeKind kind : {LobeKind::kAll, LobeKind::kSharp, LobeKind::kBroad}) {
      const BsdfValue value = b.value(direction, kind);
      EXPECT_EQ(value.f, b.evaluate(direction, kind)) << GetParam().name;
      EXPECT_EQ(value.pdf, b.pdf(direction)) << GetParam().name;
      reached += maxComponent(value.f) > 0.0f ? 1 : 0;
    }
  }
  EXPECT_GT(reached, 100);
}

TEST_P(BsdfTest, ReflectionIsReciprocal) {
  const vec3 out = outgoing(surface_, GetParam().cosine);
  const vec3 in = Basis(surface_.geometricNormal).toWorld(glm::normalize(vec3(0.4f, 0.3f, 0.6f)));
  const Bsdf there(scene_, surface_, out), back(scene_, surface_, in);
  const float a = there.evaluate(in).y / glm::dot(in, surface_.geometricNormal);
  const float b = back.evaluate(out).y / glm::dot(out, surface_.geometricNormal);
  EXPECT_NEAR(a, b, 1e-3f * (a + b) + 1e-6f);
}

/// With bent normals too, of what arrives along a way as much goes on whichever end it comes from.
TEST_P(BsdfTest, PhotonsCarryWhatPathsFind) {
  const vec3 geometric = surface_.geometricNormal;
  surface_.shadingNormal = glm::normalize(geometric + 0.4f * surface_.tangent);
  const vec3 out = outgoing(surface_, GetParam().cosine);
  const vec3 in = Basis(geometric).toWorld(glm::normalize(vec3(0.4f, 0.3f, 0.6f)));
  const Bsdf path(scene_, surface_, out), photon(scene_, surface_, in);
  const float found = path.evaluate(in).y / glm::dot(in, geometric);
  const float carried =
      photon.evaluate(out).y * photon.photonFactor(out) / glm::dot(out, geometric);
  EXPECT_NEAR(found, carried, 1e-3f * (found + carried) + 1e-6f);
}

INSTANTIATE_TEST_SUITE_P(Materials, BsdfTest, ::testing::ValuesIn(cases()),
                         [](const auto& parameter) { return parameter.param.name; });

TEST(Bsdf, LambertianAlbedoIsExact) {
  Scene scene;
  scene.materials = {test::lambert(0.5f)};
  const Surface s = surfaceAtOrigin();
  const Bsdf b(scene, s, outgoing(s, 0.3f));
  for (std::uint32_t i = 0; i < 100; ++i) {
    Sampler sampler(i, 0, 0);
    BsdfSample sample;
    ASSERT_TRUE(b.sample(sampler, sample));
    EXPECT_NEAR(sample.weight.x, 0.5f, 1e-5f);
  }
  EXPECT_TRUE(b.cacheable());
  EXPECT_NEAR(b.cachedAlbedo().x, 0.5f, 1e-6f);
}

/// What a filter takes out of light and puts back: textured metals and coated floors keep their
/// pattern only if it has the colours of what they reflect.
TEST(Bsdf, AlbedoHasTheColoursOfWhatIsReflected) {
  Scene scene;
  scene.materials = {glossy(1.0f, 0.5f, 0.0f, false), glossy(1.0f, 0.0f, 0.0f, false),
                     glossy(0.0f, 0.0f, 0.0f, false), glossy(0.0f, 0.4f, 0.0f, false),
                     glossy(0.5f, 0.3f, 0.0f, false), test::lambert(0.5f)};
  for (Material& m : scene.materials) m.baseColor = vec4(0.8f, 0.4f, 0.1f, 1.0f);
  Surface s = surfaceAtOrigin();
  for (s.material = 0; s.material < scene.materials.size(); ++s.material) {
    const Bsdf b(scene, s, outgoing(s, 0.7f));
    dvec3 sum(0.0);
    for (std::uint32_t i = 0; i < 20000; ++i) {
      Sampler sampler(i, 0, 0);
      BsdfSample sample;
      if (b.sample(sampler, sample)) sum += dvec3(sample.weight);
    }
    const dvec3 albedo(b.albedo());
    EXPECT_NEAR(albedo.y / albedo.x, sum.y / sum.x, 0.03) << s.material;
    EXPECT_NEAR(albedo.z / albedo.x, sum.z / sum.x, 0.03) << s.material;
    EXPECT_NEAR(albedo.x / (sum.x / 20000), 1.0, 0.15) << s.material;
  }
  scene.materials = {glossy(0.0f, 0.0f, 1.0f, true)};
  s.material = 0;
  EXPECT_EQ(Bsdf(scene, s, outgoing(s, 0.7f)).albedo(), vec3(1.0f));
}

/// Of light from everywhere, rough surfaces and grazing angles too: that of a filter, and of a
/// cache of irradiance, which leaves out what is sharp.
TEST(Bsdf, AlbedoIsWhatIsReflected) {
  Scene scene;
  std::vector<Material>& all = scene.materials;
  for (float roughness : {0.0f, 0.2f, 0.5f, 0.8f, 1.0f}) {
    all.push_back(glossy(0.0f, roughness, 0.0f, false));
    all.push_back(glossy(1.0f, roughness, 0.0f, false));
    all.push_back(ofIndex(roughness, false));
    all.push_back(filmed(1.0f, 1.4f));
    all.back().roughness = roughness;
    all.push_back(coated(test::lambert(0.5f), 1.0f, roughness));
  }
  all.push_back(brushed(0.5f, 0.5f));
  all.push_back(cloth(vec3(0.9f, 0.5f, 0.2f), 0.5f));
  all.push_back(coated(glossy(0.0f, 0.6f, 0.0f, false), 0.7f, 0.4f));
  for (Material& m : all) m.baseColor = vec4(0.8f, 0.3f, 0.05f, 1.0f);
  Surface s = surfaceAtOrigin();
  for (s.material = 0; s.material < all.size(); ++s.material) {
    for (float cosine : {0.1f, 0.3f, 0.6f, 1.0f}) {
      constexpr std::uint32_t kCount = 20000;
      const Bsdf b(scene, s, outgoing(s, cosine));
      dvec3 sum(0.0);
      for (std::uint32_t i = 0; i < kCount; ++i) {
        Sampler sampler(i, 0, 0);
        BsdfSample sample;
        if (b.sample(sampler, sample)) sum += dvec3(sample.weight) / double(kCount);
      }
      const vec3 right = glm::min(vec3(sum), vec3(1.0f));
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(b.albedo()[k], right[k], 0.012f + 0.02f * right[k])
            << s.material << " " << cosine << " " << k;
      }
    }
  }
}

TEST(Bsdf, RoughnessUpToATenthShowsOthers) {
  Scene scene;
  scene.materials = {glossy(1.0f, 0.05f, 0.0f, false), glossy(1.0f, 0.1f, 0.0f, false),
                     glossy(0.0f, 0.1f, 1.0f, false), glossy(1.0f, 0.11f, 0.0f, false)};
  scene.materials[2].baseColor = vec4(1.0f);
  Surface s = surfaceAtOrigin();
  for (s.material = 0; s.material < 4; ++s.material) {
    EXPECT_EQ(Bsdf(scene, s, outgoing(s, 0.7f)).showsOthers(), s.material < 3) << s.material;
  }
}

TEST(Bsdf, MirrorAndGlassAreDelta) {
  Scene scene;
  scene.materials = {glossy(1.0f, 0.0f, 0.0f, false), glossy(0.0f, 0.0f, 1.0f, true)};
  Surface s = surfaceAtOrigin();
  const vec3 out = outgoing(s, 0.6f);
  BsdfSample sample;
  Sampler sampler(1, 0, 0);
  const Bsdf mirror(scene, s, out);
  EXPECT_TRUE(mirror.onlyDelta());
  ASSERT_TRUE(mirror.sample(sampler, sample));
  EXPECT_TRUE(sample.delta);
  EXPECT_NEAR(glm::dot(sample.direction, s.geometricNormal), 0.6f, 1e-5f);

  s.material = 1;
  const Bsdf glass(scene, s, out);
  int transmitted = 0;
  double kept = 0.0;
  for (std::uint32_t i = 0; i < 4000; ++i) {
    Sampler one(i, 0, 0);
    ASSERT_TRUE(glass.sample(one, sample));
    transmitted += sample.transmitted;
    kept += static_cast<double>(sample.weight.x * sample.etaSquared) / 4000;
    if (sample.transmitted) {  // Snell's law
      const float sinIn = 0.8f, cosT = -glm::dot(sample.direction, s.geometricNormal);
      EXPECT_NEAR(std::sqrt(1.0f - cosT * cosT), sinIn / 1.5f, 1e-4f);
    }
  }
  EXPECT_NEAR(transmitted / 4000.0, 1.0 - static_cast<double>(fresnelDielectric(0.6f, 1.5f)), 0.15);
  EXPECT_GT(kept, 0.75);
}

/// KHR_materials_specular: glass reflects as much less as it says, and lets the rest through. Seen
/// straight on through a thin sheet: R = 2 F / (1 + F).
TEST(Bsdf, GlassReflectsByItsSpecularFactor) {
  Scene scene;
  const Surface s = surfaceAtOrigin();
  const vec3 out = outgoing(s, 1.0f);
  const float both = 2.0f * 0.04f / 1.04f;
  for (const float specular : {0.0f, 0.5f, 1.0f}) {
    Material m = glossy(0.0f, 0.0f, 1.0f, false);
    m.specular = specular;
    m.specularColor = vec3(0.5f, 1.0f, 2.0f);
    scene.materials = {m};
    const Bsdf bsdf(scene, s, out);
    const vec3 reflected = both * specular * m.specularColor;
    vec3 seen(0.0f), through(0.0f);
    for (std::uint32_t i = 0; i < 4096; ++i) {
      Sampler sampler(i, 0, 0);
      BsdfSample sample;
      if (!bsdf.sample(sampler, sample)) continue;
      (sample.transmitted ? through : seen) += sample.weight / 4096.0f;
    }
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(bsdf.clearTransmission()[c], m.baseColor[c] * (1.0f - reflected[c]), 1e-5f);
      EXPECT_NEAR(seen[c], reflected[c], 0.02f);
      EXPECT_NEAR(through[c], m.baseColor[c] * (1.0f - reflected[c]), 0.03f);
    }
    EXPECT_EQ(seen == vec3(0.0f), specular == 0.0f);
  }
}

/// Total reflection is not a matter of factors.
TEST(Bsdf, GlassReflectsTotallyWhateverItsFactor) {
  Scene scene;
  Surface s = surfaceAtOrigin();
  s.geometricNormal = s.shadingNormal = -s.geometricNormal;
  const vec3 out = outgoing(surfaceAtOrigin(), 0.3f);  // from within
  Material m = glossy(0.0f, 0.0f, 1.0f, true);
  m.specular = 0.0f;
  scene.materials = {m};
  const Bsdf bsdf(scene, s, out);
  EXPECT_EQ(bsdf.clearTransmission(), vec3(0.0f));
  Sampler sampler(1, 0, 0);
  BsdfSample sample;
  ASSERT_TRUE(bsdf.sample(sampler, sample));
  EXPECT_FALSE(sample.transmitted);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(sample.weight[c], 1.0f, 1e-6f);
}

TEST(Fresnel, KnownValues) {
  EXPECT_NEAR(fresnelDielectric(1.0f, 1.5f), 0.04f, 1e-6f);
  EXPECT_NEAR(fresnelDielectric(0.0f, 1.5f), 1.0f, 1e-6f);
  EXPECT_EQ(fresnelDielectric(0.5f, 1.0f / 1.5f), 1.0f);  // beyond the critical angle
  EXPECT_NEAR(fresnelDielectric(0.3f, 1.0f), 0.0f, 1e-6f);
}

TEST(Ggx, DensityIntegratesToOneOverProjectedArea) {
  for (float alpha : {0.01f, 0.1f, 0.5f, 1.0f}) {
    double sum = 0.0;
    constexpr int kSteps = 200000;
    for (int i = 0; i < kSteps; ++i) {
      const double theta = 0.5 * std::numbers::pi * (i + 0.5) / kSteps;
      sum += static_cast<double>(ggxDensity(static_cast<float>(std::cos(theta)), alpha)) *
             std::cos(theta) * std::sin(theta) * 2.0 * std::numbers::pi * 0.5 * std::numbers::pi /
             kSteps;
    }
    EXPECT_NEAR(sum, 1.0, 0.01) << alpha;
  }
}

}  // namespace
}  // namespace trex
