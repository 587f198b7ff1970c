// Materials, textures, lights and cameras of pbrt files, against what pbrt's own documents say.
#include <numbers>

#include "src/scene/fresnel.h"
#include "src/scene/pbrt_lights.h"
#include "src/scene/pbrt_materials.h"
#include "src/scene/pbrt_sky.h"
#include "src/scene/spectra.h"
#include "src/scene/texture.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

const std::string kV3 = "Scale -1 1 1\nFilm \"image\"\nCamera \"perspective\"\nWorldBegin\n";
const std::string kV4 = "Scale -1 1 1\nFilm \"rgb\"\nCamera \"perspective\"\nWorldBegin\n";
const std::string kQuad =
    "Shape \"trianglemesh\" \"point P\" [0 0 0 1 0 0 1 1 0 0 1 0] \"integer indices\" [0 1 2 0 2 3]"
    " \"float uv\" [0 0 1 0 1 1 0 1]\n";

class ScenePbrtLooks : public SceneTest {
 protected:
  Scene read(const std::string& world, const std::string& head = kV3) const {
    return import("a.pbrt", head + world);
  }
  Material material(const std::string& world, const std::string& head = kV3) const {
    const Scene s = read(world + kQuad, head);
    said_ = s.replaced.count;
    return s.materials[s.meshes[0].material];
  }
  static void expectColor(const vec3& a, const vec3& b, float error = 1e-4f) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], error) << "channel " << c;
  }
  mutable std::uint64_t said_ = 0;
};

TEST_F(ScenePbrtLooks, Version3Materials) {
  Material m = material("Material \"matte\" \"rgb Kd\" [.1 .2 .3]\n");
  expectColor(vec3(m.baseColor), {0.1f, 0.2f, 0.3f});
  EXPECT_EQ(m.specular, 0.0f);
  EXPECT_EQ(said_, 0u);
  m = material("");
  expectColor(vec3(m.baseColor), vec3(0.5f));

  m = material(
      "Material \"plastic\" \"color Kd\" [.1 .2 .3] \"rgb Ks\" [.2 .4 .4]\n"
      "\"float roughness\" .2 \"bool remaproughness\" \"false\"\n");
  EXPECT_FLOAT_EQ(m.specular, 0.4f);
  expectColor(m.specularColor, {0.5f, 1.0f, 1.0f});
  EXPECT_FLOAT_EQ(m.roughness, std::sqrt(0.2f));  // alpha 0.2
  EXPECT_EQ(said_, 0u);

  m = material("Material \"metal\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3.9 2.4 2.1]\n");
  EXPECT_EQ(m.metallic, 1.0f);
  expectColor(vec3(m.baseColor), vec3(1.0f));
  expectColor(m.finish.metalEta, {0.2f, 0.9f, 1.1f});
  expectColor(m.finish.metalK, {3.9f, 2.4f, 2.1f});
  EXPECT_FLOAT_EQ(m.roughness, std::sqrt(detail::pbrtAlpha(0.01f, false)));
  const Material named = material(
      "Material \"metal\" \"spectrum eta\" \"spds/Au.eta.spd\" "
      "\"spectrum k\" \"spds/Au.k.spd\"\n");
  expectColor(named.finish.metalEta, detail::conductorNamed("Au")->eta);
  expectColor(named.finish.metalK, detail::conductorNamed("Au")->k);

  m = material("Material \"mirror\"\n");
  expectColor(vec3(m.baseColor), vec3(0.9f));
  EXPECT_EQ(m.roughness, 0.0f);
  m = material("Material \"glass\" \"float index\" 1.6 \"rgb Kt\" [.9 1 .9]\n");
  EXPECT_EQ(m.ior, 1.6f);
  EXPECT_EQ(m.transmission, 1.0f);
  EXPECT_TRUE(m.volume);
  EXPECT_EQ(m.roughness, 0.0f);
  expectColor(vec3(m.baseColor), {0.9f, 1.0f, 0.9f});
  EXPECT_EQ(said_, 0u);

  m = material("Material \"substrate\" \"rgb Ks\" [.04 .04 .04]\n");
  EXPECT_NEAR(m.ior, 1.5f, 1e-3f);
  m = material(
      "Material \"disney\" \"rgb color\" [.1 .5 .9] \"float metallic\" .3 \"float roughness\" "
      ".4 \"float eta\" 1.4\n");
  EXPECT_FLOAT_EQ(m.metallic, 0.3f);
  EXPECT_FLOAT_EQ(m.roughness, 0.4f);
  EXPECT_FLOAT_EQ(m.ior, 1.4f);
  EXPECT_EQ(said_, 0u);
}

TEST_F(ScenePbrtLooks, UberHasOpacityAndTransmission) {
  Material m = material("Material \"uber\" \"rgb Kd\" [.3 .3 .3] \"rgb opacity\" [.25 .25 .25]\n");
  EXPECT_EQ(m.alphaMode, AlphaMode::kBlend);
  EXPECT_FLOAT_EQ(m.baseColor.a, 0.25f);
  EXPECT_EQ(said_, 0u);
  m = material("Material \"uber\" \"rgb Kd\" [.2 .2 .2] \"rgb Kt\" [.6 .6 .6]\n");
  EXPECT_FLOAT_EQ(m.transmission, 0.75f);
  expectColor(vec3(m.baseColor) * m.transmission, vec3(0.6f));
  EXPECT_EQ(said_, 1u);
}

TEST_F(ScenePbrtLooks, Version4Materials) {
  Material m = material("Material \"diffuse\" \"rgb reflectance\" [.1 .2 .3]\n", kV4);
  expectColor(vec3(m.baseColor), {0.1f, 0.2f, 0.3f});
  m = material("Material \"coateddiffuse\" \"float roughness\" .25 \"float eta\" 1.3\n", kV4);
  EXPECT_FLOAT_EQ(m.roughness, std::sqrt(0.5f));  // alpha is the root of pbrt-v4's roughness
  EXPECT_FLOAT_EQ(m.ior, 1.3f);
  EXPECT_EQ(m.specular, 1.0f);
  m = material(
      "Material \"conductor\" \"spectrum eta\" \"metal-Ag-eta\" \"spectrum k\" \"metal-Ag-k\"\n",
      kV4);
  expectColor(m.finish.metalK, detail::conductorNamed("Ag")->k);
  EXPECT_EQ(m.roughness, 0.0f);
  m = material("Material \"conductor\" \"rgb reflectance\" [.5 .6 .7]\n", kV4);
  expectColor(vec3(m.baseColor), {0.5f, 0.6f, 0.7f});
  m = material("Material \"dielectric\" \"spectrum eta\" \"glass-SF11\"\n", kV4);
  EXPECT_FLOAT_EQ(m.ior, 1.7847f);
  EXPECT_TRUE(m.volume);
  m = material("Material \"thindielectric\" \"float eta\" 1.2\n", kV4);
  EXPECT_FALSE(m.volume);
  EXPECT_EQ(m.transmission, 1.0f);
  EXPECT_EQ(said_, 0u);
}

TEST_F(ScenePbrtLooks, ApproximationsAreSaid) {
  for (const char* text :
       {"Material \"matte\" \"float sigma\" 20\n", "Material \"translucent\"\n",
        "Material \"plastic\" \"float uroughness\" .1 \"float vroughness\" .3\n",
        "Material \"glass\" \"rgb Kr\" [0 0 0]\n", "Material \"disney\" \"float sheen\" 1\n",
        "Material \"diffusetransmission\"\n", "Material \"coatedconductor\"\n",
        "Material \"subsurface\" \"string name\" \"Skin1\"\n", "Material \"hair\"\n",
        "Material \"measured\" \"string filename\" \"a.bsdf\"\n",
        "Material \"dielectric\" \"float eta\" .75\n",
        "MakeNamedMaterial \"a\" \"string type\" \"matte\"\n"
        "MakeNamedMaterial \"b\" \"string type\" \"mirror\"\n"
        "Material \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\"\n"}) {
    material(text);
    EXPECT_EQ(said_, 1u) << text;
  }
}

TEST_F(ScenePbrtLooks, MixesTakeSharesAndInterfacesAreNotSeen) {
  const std::string two =
      "MakeNamedMaterial \"a\" \"string type\" \"matte\" \"rgb Kd\" [0 0 0]\n"
      "MakeNamedMaterial \"b\" \"string type\" \"matte\" \"rgb Kd\" [.8 .8 .8]\n"
      "MakeNamedMaterial \"n\" \"string type\" \"interface\"\n";
  Material m = material(two +
                        "Material \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\""
                        " \"b\" \"rgb amount\" [.25 .25 .25]\n");
  EXPECT_NEAR(m.baseColor.x, 0.6f, 1e-6f);  // v3: amount of the first
  m = material(two + "Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .25\n");
  EXPECT_NEAR(m.baseColor.x, 0.2f, 1e-6f);  // v4: of the second
  m = material(two + "Material \"mix\" \"string materials\" [\"n\" \"b\"] \"float amount\" .25\n");
  EXPECT_EQ(m.baseColor.a, 0.25f);
  EXPECT_EQ(said_, 0u);
  const Scene s = read("Material \"interface\"\n" + kQuad + "Material \"\"\n" + kQuad +
                       "Material \"none\"\n" + kQuad + "NamedMaterial \"x\"\n" + kQuad);
  EXPECT_EQ(s.instances.size(), 1u);
}

TEST_F(ScenePbrtLooks, GlassAbsorbsAsItsMedium) {
  const Material m = material(
      "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"rgb sigma_a\" "
      "[.5 1 2] \"rgb sigma_s\" [0 0 0]\nMediumInterface \"m\" \"\"\n"
      "Material \"glass\"\n");
  EXPECT_EQ(said_, 0u);
  const vec3 absorbs = -glm::log(m.attenuationColor) / m.attenuationDistance;
  expectColor(absorbs, {0.5f, 1.0f, 2.0f});
}

TEST_F(ScenePbrtLooks, ImagesArePlacedFromTheLowerLeft) {
  write("t.png", tinyPng());  // red, green; blue, white
  const Scene s = read(
      "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\"\n"
      "\"float uscale\" 2 \"float vscale\" 3 \"float udelta\" .25 \"float vdelta\" .5\n"
      "Texture \"h\" \"color\" \"scale\" \"texture tex1\" \"t\" \"rgb tex2\" [.5 .5 .5]\n"
      "Material \"matte\" \"texture Kd\" \"h\"\n" +
      kQuad);
  const Material& m = s.materials[s.meshes[0].material];
  expectColor(vec3(m.baseColor), vec3(0.5f));
  EXPECT_EQ(s.images.size(), 1u);
  for (const vec2& uv : {vec2(0.1f, 0.2f), vec2(0.9f, 0.4f)}) {
    const vec2 st(2.0f * uv.x + 0.25f, 3.0f * uv.y + 0.5f);
    const vec2 placed = transformUv(m.baseColorTexture, vec2(uv.x, 1.0f - uv.y));
    EXPECT_NEAR(placed.x, st.x, 1e-5f);
    EXPECT_NEAR(placed.y, 1.0f - st.y, 1e-5f);
  }
  EXPECT_EQ(s.meshes[0].texCoords[0], vec2(0, 1));
  EXPECT_EQ(s.meshes[0].texCoords[2], vec2(1, 0));
}

TEST_F(ScenePbrtLooks, TexturesAreMadeOfOthers) {
  write("t.png", tinyPng());
  const auto color = [&](const std::string& text, vec2 uv) {
    const Scene s = read(
        "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\" "
        "\"string filter\" \"point\"\n" +
            text + "Material \"diffuse\" \"texture reflectance\" \"m\"\n" + kQuad,
        kV4);
    EXPECT_EQ(s.replaced.count, 0u) << text;
    const Material& m = s.materials[s.meshes[0].material];
    return vec3(m.baseColor) * vec3(sampleTexture(s.images[m.baseColorTexture.image],
                                                  m.baseColorTexture, {uv.x, 1.0f - uv.y}, true));
  };
  const vec2 upperLeft(0.25f, 0.75f);
  expectColor(
      color("Texture \"m\" \"spectrum\" \"scale\" \"texture tex\" \"t\" \"float scale\" .5\n",
            upperLeft),
      {0.5f, 0.0f, 0.0f});
  expectColor(
      color("Texture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"t\" \"rgb tex2\" [0 1 0] "
            "\"float amount\" .25\n",
            upperLeft),
      {0.75f, 0.25f, 0.0f}, 5e-3f);
  expectColor(
      color("Texture \"m\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\" \"bool invert\" "
            "true \"string filter\" \"point\"\n",
            upperLeft),
      {0.0f, 1.0f, 1.0f});
  // The first of four by four squares lies at the lower left.
  const std::string checks =
      "Texture \"m\" \"spectrum\" \"checkerboard\" \"float uscale\" 4 \"float "
      "vscale\" 4 \"rgb tex1\" [.9 .9 .9] \"rgb tex2\" [.1 .1 .1]\n";
  expectColor(color(checks, {0.1f, 0.1f}), vec3(0.9f), 5e-3f);
  expectColor(color(checks, {0.3f, 0.1f}), vec3(0.1f), 5e-3f);
  expectColor(color(checks, {0.3f, 0.3f}), vec3(0.9f), 5e-3f);
  expectColor(color(checks, {0.1f, 0.6f}), vec3(0.9f), 5e-3f);
}

TEST_F(ScenePbrtLooks, AlphaAndRoughnessTextures) {
  write("t.png", tinyPng());
  const std::string textures =
      "Texture \"r\" \"float\" \"imagemap\" \"string filename\" \"t.png\" \"float scale\" .5\n";
  const Scene s = read(textures +
                       "Material \"plastic\" \"texture roughness\" \"r\" \"bool "
                       "remaproughness\" \"false\"\n" +
                       kQuad.substr(0, kQuad.size() - 1) + " \"texture alpha\" \"r\"\n");
  EXPECT_EQ(s.replaced.count, 0u);
  const Material& m = s.materials[s.meshes[0].material];
  ASSERT_TRUE(m.metallicRoughnessTexture.present());
  const Image& rough = s.images[m.metallicRoughnessTexture.image];
  // White times 0.5 is an alpha of 0.5; red has a third of it.
  EXPECT_NEAR(rough.bytes[3 * 3 + 1] / 255.0, std::sqrt(0.5), 3e-3);
  EXPECT_NEAR(rough.bytes[1] / 255.0, std::sqrt(0.5 / 3.0), 3e-3);
  EXPECT_EQ(m.alphaMode, AlphaMode::kBlend);
  const Image& alpha = s.images[m.baseColorTexture.image];
  EXPECT_EQ(alpha.channels, 4);
  EXPECT_NEAR(alpha.bytes[15], 127.5, 1.0);
}

TEST_F(ScenePbrtLooks, DefaultTexCoordsWhereTheyAreNeeded) {
  write("t.png", tinyPng());
  const Scene s = read(
      "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\"\n"
      "Material \"matte\" \"texture Kd\" \"t\"\nShape \"trianglemesh\" \"point P\" "
      "[0 0 0 1 0 0 1 1 0 0 1 0] \"integer indices\" [0 1 2 0 2 3]\n");
  ASSERT_EQ(s.meshes[0].positions.size(), 6u);
  EXPECT_EQ(s.meshes[0].texCoords[3], vec2(0, 1));
  EXPECT_EQ(s.meshes[0].texCoords[5], vec2(1, 0));
}

TEST_F(ScenePbrtLooks, PointAndDistantLights) {
  const Scene s = read(
      "Translate 1 2 3\nScale 2 2 2\n"
      "LightSource \"point\" \"point from\" [1 0 0] \"rgb I\" [4 5 6] \"rgb scale\" [2 2 2]\n"
      "LightSource \"distant\" \"rgb L\" [1 2 3] \"point from\" [0 3 0] \"point to\" "
      "[0 0 4]\n" +
      kQuad);
  ASSERT_EQ(s.lights.size(), 2u);
  EXPECT_EQ(s.lights[0].position, dvec3(3, 2, 3));
  expectColor(s.lights[0].intensity, {8, 10, 12});
  expectColor(s.lights[1].intensity, {1, 2, 3});
  expectColor(s.lights[1].direction, {0, -0.6f, 0.8f});
  const Scene v4 = read(
      "LightSource \"point\" \"rgb I\" [1 1 1] \"float power\" 100\n"
      "LightSource \"point\" \"blackbody I\" 3000 \"float scale\" 5\n"
      "LightSource \"distant\" \"float illuminance\" 7\n" +
          kQuad,
      kV4);
  expectColor(v4.lights[0].intensity, vec3(100.0f / (4.0f * kPi)), 1e-3f);
  EXPECT_NEAR(luminance(v4.lights[1].intensity), 5.0f, 1e-3f);  // normalised to luminance 1
  EXPECT_GT(v4.lights[1].intensity.x, 2.0f * v4.lights[1].intensity.z);
  expectColor(v4.lights[2].intensity, vec3(7.0f));
  // pbrt-v3: a black body whose largest value is 1, times the second number.
  const Scene v3 = read("LightSource \"point\" \"blackbody I\" [3000 5]\n" + kQuad);
  expectColor(v3.lights[0].intensity, 5.0f * detail::blackbodyRgb(3000.0, true), 1e-3f);
}

TEST_F(ScenePbrtLooks, SpotsKeepTheirPower) {
  for (const bool version4 : {false, true}) {
    const Scene s = read(
        "LightSource \"spot\" \"rgb I\" [1 1 1] \"point from\" [0 0 0] \"point to\" "
        "[0 -2 0] \"float coneangle\" 40 \"float conedeltaangle\" 15\n" +
            kQuad,
        version4 ? kV4 : kV3);
    ASSERT_EQ(s.lights.size(), 1u);
    const Light& light = s.lights[0];
    expectColor(light.direction, {0, -1, 0});
    EXPECT_NEAR(light.outerConeAngle, glm::radians(40.0f), 1e-6f);
    const double end = std::cos(glm::radians(40.0)), start = std::cos(glm::radians(25.0));
    const double inner = std::cos(double{light.innerConeAngle});
    double theirs = 0.0, ours = 0.0;
    constexpr int kSteps = 100'000;
    for (int i = 0; i < kSteps; ++i) {
      const double c = end + (1.0 - end) * (i + 0.5) / kSteps;
      const double t = std::clamp((c - end) / (start - end), 0.0, 1.0);
      theirs += version4 ? t * t * (3.0 - 2.0 * t) : t * t * t * t;
      const double g = std::clamp((c - end) / (inner - end), 0.0, 1.0);
      ours += g * g;
    }
    EXPECT_NEAR(ours / theirs, 1.0, 1e-4) << version4;
  }
}

TEST_F(ScenePbrtLooks, AreaLights) {
  const std::string quad = "Scale 2 3 1\n" + kQuad;  // area 6
  const auto emitter = [&](const std::string& light, const std::string& head) {
    const Scene s = read(light + quad, head);
    return s.materials[s.meshes[0].material];
  };
  Material m =
      emitter("AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"rgb scale\" [2 2 2]\n", kV3);
  expectColor(m.emission, {2, 4, 6});
  EXPECT_FALSE(m.doubleSided);
  m = emitter(
      "AreaLightSource \"diffuse\" \"bool twosided\" true \"rgb L\" [1 1 1] \"float power\" 24\n",
      kV4);
  EXPECT_TRUE(m.doubleSided);
  expectColor(m.emission, vec3(24.0f / (2.0f * 6.0f * kPi)), 1e-4f);
  m = emitter("AreaLightSource \"diffuse\" \"spectrum L\" [400 3 700 3] \"float scale\" 2\n", kV4);
  EXPECT_NEAR(luminance(m.emission), 2.0f, 1e-4f);
  m = emitter("AreaLightSource \"diffuse\" \"spectrum L\" [300 3 900 3]\n", kV3);
  EXPECT_NEAR(luminance(m.emission), 3.0f, 0.02f);
  // The film's scale makes all light brighter.
  m = emitter(
      "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n",
      "Scale -1 1 1\nFilm \"rgb\" \"float iso\" 200\nCamera \"perspective\" \"float shutterclose\""
      " .5\nWorldBegin\n");
  expectColor(m.emission, vec3(1.0f));
  m = emitter(
      "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n",
      "Scale -1 1 1\nFilm \"image\" \"float scale\" 3\nCamera \"perspective\"\nWorldBegin\n");
  expectColor(m.emission, vec3(3.0f));
}

TEST_F(ScenePbrtLooks, ColourSpaces) {
  Material m = material(
      "ColorSpace \"rec2020\"\nMaterial \"diffuse\" \"rgb reflectance\" [.5 .5 .5]\n", kV4);
  expectColor(vec3(m.baseColor), vec3(0.5f), 1e-3f);
  // Rec. 2020 (0.2, 0.6, 0.2) in Rec. 709 [ITU-R BT.2087].
  m = material(
      "AttributeBegin\nColorSpace \"rec2020\"\nAttributeEnd\n"
      "Material \"diffuse\" \"rgb reflectance\" [.2 .6 .2]\n",
      kV4);
  expectColor(vec3(m.baseColor), {0.2f, 0.6f, 0.2f});
  m = material("ColorSpace \"rec2020\"\nMaterial \"diffuse\" \"rgb reflectance\" [.4 .6 .4]\n",
               kV4);
  expectColor(vec3(m.baseColor), {0.2825f, 0.6266f, 0.3799f}, 2e-3f);
  m = material("Material \"matte\" \"xyz Kd\" [.4752 .5 .5444]\n");
  expectColor(vec3(m.baseColor), vec3(0.5f), 2e-3f);
  m = material("Material \"matte\" \"spectrum Kd\" [300 .4 900 .4]\n");
  expectColor(vec3(m.baseColor), vec3(0.4f), 1e-3f);
  write("s.spd", "# made by a test\n300 .2\n900 .2\n");
  m = material("Material \"matte\" \"spectrum Kd\" \"s.spd\"\n");
  expectColor(vec3(m.baseColor), vec3(0.2f), 1e-3f);
}

TEST_F(ScenePbrtLooks, ConstantSkiesAddUp) {
  const Scene s = read(
      "LightSource \"infinite\" \"rgb L\" [1 2 3]\n"
      "LightSource \"infinite\" \"rgb L\" [1 1 1] \"float scale\" 2\n" +
      kQuad);
  expectColor(s.environment.color, {3, 4, 5});
  EXPECT_EQ(s.environment.map, nullptr);
  const Scene lit = read("LightSource \"infinite\" \"float illuminance\" 6.2831853\n" + kQuad, kV4);
  expectColor(lit.environment.color, vec3(2.0f), 1e-4f);
}

TEST_F(ScenePbrtLooks, EqualAreaMapsAreThat) {
  using detail::equalAreaDirection;
  using detail::equalAreaSquare;
  const auto near = [](const glm::dvec2& a, const glm::dvec2& b) {
    EXPECT_LT(glm::length(a - b), 1e-6) << a.x << " " << a.y;
  };
  near(equalAreaSquare({0, 0, 1}), {0.5, 0.5});
  near(equalAreaSquare({1, 0, 0}), {1.0, 0.5});
  near(equalAreaSquare({0, 1, 0}), {0.5, 1.0});
  near(equalAreaSquare(glm::normalize(dvec3(1e-9, 1e-9, -1))), {1.0, 1.0});
  constexpr int kSide = 64;
  double above = 0.0, moment = 0.0;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const glm::dvec2 p((x + 0.5) / kSide, (y + 0.5) / kSide);
      const dvec3 d = equalAreaDirection(p);
      EXPECT_NEAR(glm::length(d), 1.0, 1e-9);
      near(equalAreaSquare(d), p);
      above += d.x > 0.5;
      moment += d.z * d.z;
    }
  }
  // Equal areas: a quarter of the sphere has x above 0.5, and z^2 is 1/3 on average.
  EXPECT_NEAR(above / (kSide * kSide), 0.25, 0.01);
  EXPECT_NEAR(moment / (kSide * kSide), 1.0 / 3.0, 1e-3);
}

/// What our environment shows in a direction (nearest texel).
vec3 shown(const Environment& e, const dvec3& direction) {
  const dvec3 d = glm::normalize(direction);
  const double u = 0.5 + std::atan2(d.x, -d.z) / (2.0 * std::numbers::pi);
  const double v = std::acos(d.y) / std::numbers::pi;
  const Image& map = *e.map;
  const int x = std::min(static_cast<int>(u * map.width), map.width - 1);
  const int y = std::min(static_cast<int>(v * map.height), map.height - 1);
  const float* texel = &map.floats[(std::size_t(y) * map.width + x) * 3];
  return e.color * vec3(texel[0], texel[1], texel[2]);
}

TEST_F(ScenePbrtLooks, SkyMapsAreTurnedWithTheirLight) {
  for (const bool square : {false, true}) {
    for (const bool mirrored : {false, true}) {
      detail::PbrtSky::Map map;
      map.square = square;
      map.image.width = square ? 128 : 256;
      map.image.height = 128;
      map.image.channels = 3;
      map.factor = vec3(2.0f);
      const dvec3 c = glm::normalize(dvec3(0.3, -0.5, 0.8));
      // A cap of 20 degrees around c, in the light's own space.
      for (int y = 0; y < map.image.height; ++y) {
        for (int x = 0; x < map.image.width; ++x) {
          const double u = (x + 0.5) / map.image.width, v = (y + 0.5) / map.image.height;
          const double phi = 2.0 * std::numbers::pi * u, theta = std::numbers::pi * v;
          const dvec3 d = square ? detail::equalAreaDirection({u, v})
                                 : dvec3(std::sin(theta) * std::cos(phi),
                                         std::sin(theta) * std::sin(phi), std::cos(theta));
          const float value = glm::dot(d, c) > std::cos(glm::radians(20.0)) ? 1.0f : 0.0f;
          map.image.floats.insert(map.image.floats.end(), {value, value, 0.5f});
        }
      }
      map.toWorld = glm::dmat3(0, 0, 1, 1, 0, 0, 0, 1, 0);  // x to z, y to x, z to y
      const dvec3 world(c.y, c.z, c.x);
      detail::PbrtSky sky;
      sky.add(std::move(map));
      sky.add(vec3(0, 0, 1));
      const glm::dmat3 ours(mirrored ? -1.0 : 1.0, 0, 0, 0, 1, 0, 0, 0, 1);
      const Environment e = sky.environment(ours);
      expectColor(shown(e, ours * world), {2, 2, 2});
      expectColor(shown(e, ours * -world), {0, 0, 2});
      expectColor(shown(e, ours * (world * dvec3(-1, 1, 1))), {0, 0, 2});
      expectColor(shown(e, ours * (world * dvec3(1, 1, -1))), {0, 0, 2});
      // The cap's share of the sphere stays.
      double sum = 0.0;
      for (int y = 0; y < e.map->height; ++y) {
        const double ring = std::sin(std::numbers::pi * (y + 0.5) / e.map->height);
        for (int x = 0; x < e.map->width; ++x) {
          sum += ring * e.map->floats[(std::size_t(y) * e.map->width + x) * 3];
        }
      }
      sum *= std::numbers::pi / (2.0 * e.map->width * e.map->height);
      EXPECT_NEAR(sum / 2.0, 0.5 * (1.0 - std::cos(glm::radians(20.0))), 1e-3);
    }
  }
}

TEST_F(ScenePbrtLooks, SkyMapsOfFiles) {
  std::string pfm = "PF\n4 2\n-1.0\n";
  std::vector<float> rows;  // from the bottom up
  for (int i = 0; i < 8; ++i) rows.insert(rows.end(), {i < 4 ? 0.0f : 3.0f, 1.0f, 0.0f});
  write("sky.pfm", pfm + bytesOf(rows));
  const Scene s =
      read("Rotate -90 1 0 0\nLightSource \"infinite\" \"string mapname\" \"sky.pfm\"\n" + kQuad);
  EXPECT_EQ(s.replaced.count, 0u);
  ASSERT_NE(s.environment.map, nullptr);
  expectColor(shown(s.environment, {0.1, 1, 0.1}), {3, 1, 0});  // +z of the light is up
  expectColor(shown(s.environment, {0.1, -1, 0.1}), {0, 1, 0});
  EXPECT_TRUE(anyReplaced(
      read("LightSource \"infinite\" \"string mapname\" \"none.pfm\"\n" + kQuad), "none.pfm"));
}

/// Where a point lies in a picture: right and up of its middle, by half its height.
glm::dvec2 projected(const Camera& c, const dvec3& p) {
  const dvec3 d = p - c.eye;
  const dvec3 right = glm::cross(dvec3(c.forward), dvec3(c.up));
  const double scale =
      c.orthographic
          ? 2.0 / double{c.orthographicHeight}
          : 1.0 / (glm::dot(d, dvec3(c.forward)) * std::tan(0.5 * double{c.verticalFov}));
  return scale * glm::dvec2(glm::dot(d, right), glm::dot(d, dvec3(c.up)));
}

TEST_F(ScenePbrtLooks, PicturesAreNotMirrored) {
  // pbrt's rule: in camera space +x is right in the picture, +y up, +z forward.
  for (const char* head :
       {"LookAt 1 2 -5  0 1 0  0 1 0\n", "Scale -1 1 1\nLookAt 1 2 -5  0 1 0  0 1 0\n",
        "Rotate 30 1 2 3\nTranslate 0 -1 7\n"}) {
    const Scene s = import("a.pbrt", std::string(head) +
                                         "CoordinateSystem \"c\"\nCamera \"perspective\"\n"
                                         "WorldBegin\nCoordSysTransform \"camera\"\n"
                                         "Translate 1 2 5\nShape \"sphere\" \"float radius\" .1\n");
    ASSERT_EQ(s.instances.size(), 1u);
    const glm::dvec2 at = projected(s.cameras[0], dvec3(s.instances[0].transform[3]));
    EXPECT_NEAR(at.x, 0.2, 1e-6) << head;  // 90 degrees of the shorter side
    EXPECT_NEAR(at.y, 0.4, 1e-6) << head;
  }
}

TEST_F(ScenePbrtLooks, TheWorldIsMirroredWholly) {
  const std::string world =
      "WorldBegin\nLightSource \"point\" \"point from\" [2 3 4]\nLightSource \"distant\" \"point "
      "from\" "
      "[1 1 0]\n\"point to\" [0 0 0]\nAreaLightSource \"diffuse\"\n" +
      kQuad;
  const Scene s = import("a.pbrt", "Camera \"perspective\"\n" + world);
  EXPECT_EQ(s.lights[0].position, dvec3(-2, 3, 4));
  EXPECT_GT(s.lights[1].direction.x, 0.0f);
  EXPECT_EQ(s.bounds().lower, dvec3(-1, 0, 0));
  // The side that shines stays: a mirroring instance keeps the front of its mesh.
  EXPECT_LT(glm::determinant(glm::dmat3(s.instances[0].transform)), 0.0);
  const Scene same = import("a.pbrt", "Scale -1 1 1\nCamera \"perspective\"\n" + world);
  EXPECT_EQ(same.lights[0].position, dvec3(2, 3, 4));
  EXPECT_EQ(same.instances[0].transform, dmat4(1.0));
}

TEST_F(ScenePbrtLooks, FieldsOfViewAreOfTheShorterSide) {
  const auto camera = [&](const std::string& film, const std::string& text) {
    const Scene s =
        import("a.pbrt", "Film \"image\" " + film + "\nCamera " + text + "\nWorldBegin\n" + kQuad);
    EXPECT_EQ(s.replaced.count, 0u) << film << text;
    return s.cameras.at(0);
  };
  const std::string wide = "\"integer xresolution\" 400 \"integer yresolution\" 200";
  const std::string tall = "\"integer xresolution\" 200 \"integer yresolution\" 400";
  const std::string fov = "\"perspective\" \"float fov\" 60";
  EXPECT_NEAR(camera(wide, fov).verticalFov, glm::radians(60.0f), 1e-6f);
  EXPECT_NEAR(std::tan(0.5f * camera(tall, fov).verticalFov), 2.0f * std::tan(glm::radians(30.0f)),
              1e-5f);
  EXPECT_NEAR(
      camera(wide, "\"orthographic\" \"float screenwindow\" [-4 4 -2 2]").orthographicHeight, 4.0f,
      1e-6f);
  EXPECT_NEAR(camera(tall, "\"orthographic\"").orthographicHeight, 4.0f, 1e-6f);
  EXPECT_NEAR(
      std::tan(0.5f * camera(wide, fov + " \"float screenwindow\" [-1 1 -.5 .5]").verticalFov),
      0.5f * std::tan(glm::radians(30.0f)), 1e-5f);
  const Camera lens = camera(wide, fov + " \"float lensradius\" .1 \"float focaldistance\" 7");
  EXPECT_NEAR(lens.lensRadius(), 0.1f, 1e-6f);
  EXPECT_EQ(lens.focus, 7.0f);
}

TEST_F(ScenePbrtLooks, CamerasThatAreApproximated) {
  const auto camera = [&](const std::string& text) {
    const Scene s = import("a.pbrt", "Film \"image\" \"float diagonal\" 35\nCamera " + text +
                                         "\nWorldBegin\n" + kQuad);
    EXPECT_EQ(s.replaced.count, 1u) << text;
    EXPECT_TRUE(anyReplaced(s, "Camera")) << text;
    return s.cameras.at(0);
  };
  camera("\"environment\"");
  camera("\"perspective\" \"float screenwindow\" [0 2 -1 1] \"float frameaspectratio\" 1");
  // One thick lens of index 1.5 [lensmaker's equation].
  write("one.dat", "# radius thickness index aperture\n50 5 1.5 20\n-50 40 1 20\n");
  const double f = 1.0 / (0.5 * (1 / 50.0 + 1 / 50.0 - 0.5 * 5 / (1.5 * 50 * 50)));
  const Camera c =
      camera("\"realistic\" \"string lensfile\" \"one.dat\" \"float aperturediameter\" 10");
  const double height = 35.0 / std::sqrt(1.0 + 16.0 / 9.0);
  EXPECT_NEAR(std::tan(0.5 * double{c.verticalFov}), 0.5 * height / f, 1e-4);
  EXPECT_NEAR(c.lensRadius(), 0.005, 1e-6);
}

/// Heights in metres: on 4 m a texel of 4 is 1 m wide, and half a metre of white a slope of 1/2 a
/// texel and unit of height.
TEST_F(ScenePbrtLooks, BumpsAreSlopesInMetres) {
  write("h.ppm", "P3 4 1 255\n0 0 0  64 64 64  128 128 128  64 64 64\n");
  const std::string textures =
      "Texture \"h\" \"float\" \"imagemap\" \"string filename\" \"h.ppm\" \"string encoding\" "
      "\"linear\"\nTexture \"half\" \"float\" \"scale\" \"float scale\" .5 \"texture tex\" \"h\"\n"
      "Texture \"even\" \"float\" \"constant\" \"float value\" .5\n";
  const std::string quad =
      "Shape \"bilinearmesh\" \"point3 P\" [0 0 0  4 0 0  0 4 0  4 4 0] \"point2 uv\" [0 0 1 0 0 1 "
      "1 1]\n";
  for (const char* name : {"Material \"matte\" \"texture bumpmap\" \"half\"\n",
                           "Material \"diffuse\" \"texture displacement\" \"half\"\n"}) {
    const Scene s = read(textures + name + quad);
    EXPECT_EQ(s.replaced.count, 0u) << name;
    const Texture& t = s.materials[s.meshes[0].material].normalTexture;
    ASSERT_TRUE(t.present()) << name;
    const Image& image = s.images[t.image];
    ASSERT_EQ(image.width, 4);
    const float scale = s.materials[s.meshes[0].material].normalScale;
    for (int x = 0; x < 4; ++x) {
      const vec3 n =
          2.0f * vec3(image.bytes[3 * x], image.bytes[3 * x + 1], image.bytes[3 * x + 2]) / 255.0f -
          1.0f;
      const float slope = x == 1 ? 0.5f : x == 3 ? -0.5f : 0.0f;
      EXPECT_NEAR(-scale * n.x / n.z, slope * 0.5f * 128.0f / 255.0f, 0.01f) << x;
      EXPECT_NEAR(n.y / n.z, 0.0f, 0.01f);
    }
  }
  const Scene flat =
      read(textures + "Material \"diffuse\" \"texture displacement\" \"even\"\n" + quad);
  EXPECT_FALSE(flat.materials[flat.meshes[0].material].normalTexture.present());
  EXPECT_EQ(flat.replaced.count, 0u);
}

}  // namespace
}  // namespace trex::test
