// Mitsuba scenes: materials, colours and lights, each with its right value.
#include <numbers>

#include "src/scene/fresnel.h"
#include "src/scene/layered.h"
#include "tests/unit/scene_mitsuba_helpers.h"

namespace trex::test {
namespace {

using MitsubaLooks = Mitsuba;

TEST_F(MitsubaLooks, DiffuseIsLambertian) {
  Material m = material(
      "<bsdf type=\"twosided\"><bsdf type=\"diffuse\"><rgb name=\"reflectance\" "
      "value=\"0.1, 0.2, 0.3\"/></bsdf></bsdf>");
  expectNear(vec3(m.baseColor), {0.1f, 0.2f, 0.3f});
  EXPECT_EQ(m.specular, 0.0f);
  EXPECT_EQ(m.metallic, 0.0f);
  m = material("<bsdf type=\"diffuse\"/>");
  expectNear(vec3(m.baseColor), vec3(0.5f));
  expectNear(vec3(material("").baseColor), vec3(0.5f));
}

TEST_F(MitsubaLooks, ColoursOfEachKind) {
  const auto color = [&](const std::string& value) {
    return vec3(material("<bsdf type=\"diffuse\">" + value + "</bsdf>").baseColor);
  };
  expectNear(color("<rgb name=\"reflectance\" value=\"0.25\"/>"), vec3(0.25f));
  expectNear(color("<spectrum name=\"reflectance\" value=\"0.25\"/>"), vec3(0.25f));
  expectNear(color("<float name=\"reflectance\" value=\"0.25\"/>"), vec3(0.25f));
  expectNear(color("<rgb name=\"reflectance\" value=\"#ff8000\"/>"),
             {1.0f, decodeSrgb8(0x80), 0.0f});
  expectNear(color("<srgb name=\"reflectance\" value=\"1 0.5 0\"/>"), {1.0f, decodeSrgb(0.5f), 0});
  expectNear(color("<spectrum name=\"reflectance\" value=\"300:0.25, 900:0.25\"/>"), vec3(0.25f),
             1e-4f);
  write("grey.spd", "# nm value\n300 0.25\n900 0.25\n");
  expectNear(color("<spectrum name=\"reflectance\" filename=\"grey.spd\"/>"), vec3(0.25f), 1e-4f);
}

/// As Mitsuba writes scenes itself: <spectrum type="..."> with the values inside.
TEST_F(MitsubaLooks, SpectraThatAreObjects) {
  const auto radiance = [&](const std::string& type, const std::string& inside,
                            const char* tag = "spectrum") {
    return material(std::string("<emitter type=\"area\"><") + tag + " name=\"radiance\" type=\"" +
                    type + "\">" + inside + "</" + tag + "></emitter>")
        .emission;
  };
  const auto number = [](const std::string& name, const std::string& value) {
    return "<float name=\"" + name + "\" value=\"" + value + "\"/>";
  };
  const auto text = [](const std::string& name, const std::string& value) {
    return "<string name=\"" + name + "\" value=\"" + value + "\"/>";
  };
  expectNear(radiance("uniform", number("value", "3")), vec3(3.0f));
  expectNear(radiance("uniform", number("value", "3"), "texture"), vec3(3.0f));
  expectNear(radiance("d65", ""), vec3(1.0f));
  expectNear(radiance("d65", number("scale", "2.5")), vec3(2.5f));
  const std::string color = "<rgb name=\"color\" value=\"0.2 0.4 0.6\"/>";
  expectNear(radiance("d65", color + number("scale", "2")), {0.4f, 0.8f, 1.2f});
  expectNear(radiance("srgb", color), {0.2f, 0.4f, 0.6f});
  expectNear(radiance("blackbody", number("temperature", "5000")),
             material("<emitter type=\"area\"><blackbody name=\"radiance\" "
                      "temperature=\"5000K\"/></emitter>")
                 .emission,
             1.0f);
  const vec3 list = material(
                        "<emitter type=\"area\"><spectrum name=\"radiance\" value=\"400:1, "
                        "500:2, 600:3\"/></emitter>")
                        .emission;
  expectNear(radiance("irregular", text("wavelengths", "400,500,600") + text("values", "1,2,3")),
             list);
  expectNear(radiance("regular", number("wavelength_min", "400") + number("wavelength_max", "600") +
                                     text("values", "1,2,3")),
             list);
  const Material m =
      material("<bsdf type=\"diffuse\"><texture name=\"reflectance\" type=\"srgb\">" + color +
               "</texture></bsdf>");
  expectNear(vec3(m.baseColor), {0.2f, 0.4f, 0.6f});
  const Scene s = read(
      "<shape type=\"rectangle\"><emitter type=\"area\"><spectrum "
      "name=\"radiance\" type=\"irregular\">" +
      text("wavelengths", "400,500") + text("values", "1,2,3") + "</spectrum></emitter></shape>");
  EXPECT_TRUE(says(s.replaced.texts, "as many wavelengths as values"));
}

/// Mitsuba's ball with a mirroring transform has a negative radius, and shines within.
TEST_F(MitsubaLooks, BallsThatAreMirroredAreTurnedOver) {
  const auto outside = [&](const char* scale) {
    const Scene s =
        read(std::string("<shape type=\"sphere\"><transform name=\"to_world\"><scale x=\"") +
             scale + "\"/></transform></shape>");
    const Mesh& mesh = s.meshes[0];
    const glm::uvec3& t = mesh.triangles[0];
    const vec3 face = glm::cross(mesh.positions[t.y] - mesh.positions[t.x],
                                 mesh.positions[t.z] - mesh.positions[t.x]);
    EXPECT_GT(glm::dot(face, mesh.normals[t.x]), 0.0f);
    return glm::dot(face, mesh.positions[t.x]) > 0.0f;
  };
  EXPECT_TRUE(outside("1"));
  EXPECT_FALSE(outside("-1"));
}

TEST_F(MitsubaLooks, HiddenEmittersAreSaid) {
  const auto replaced = [&](const char* value) {
    return read(std::string("<integrator type=\"path\"><boolean name=\"hide_emitters\" value=\"") +
                value + "\"/></integrator>")
        .replaced.texts;
  };
  EXPECT_TRUE(says(replaced("true"), "hide_emitters"));
  EXPECT_FALSE(says(replaced("false"), "hide_emitters"));
}

TEST_F(MitsubaLooks, GlassHasItsIndex) {
  Material m = material("<bsdf type=\"dielectric\"/>");
  EXPECT_NEAR(m.ior, 1.5046f / 1.000277f, 1e-5f);
  EXPECT_EQ(m.transmission, 1.0f);
  EXPECT_TRUE(m.volume);
  EXPECT_EQ(m.roughness, 0.0f);
  m = material(
      "<bsdf type=\"roughdielectric\"><string name=\"intIOR\" value=\"water\"/>"
      "<float name=\"extIOR\" value=\"1\"/><float name=\"alpha\" value=\"0.25\"/></bsdf>");
  EXPECT_NEAR(m.ior, 1.333f, 1e-5f);
  EXPECT_NEAR(m.roughness, 0.5f, 1e-6f);
  EXPECT_FALSE(material("<bsdf type=\"thindielectric\"/>").volume);
}

TEST_F(MitsubaLooks, AMediumInGlassAbsorbs) {
  const Scene s = read(
      "<shape type=\"sphere\"><bsdf type=\"dielectric\"/><medium type=\"homogeneous\" "
      "name=\"interior\"><rgb name=\"albedo\" value=\"0\"/><rgb name=\"sigma_t\" "
      "value=\"0.5, 0.2, 0\"/></medium></shape>");
  const Material& m = s.materials.at(0);
  // Beer and Lambert, over 3 m.
  for (int c = 0; c < 3; ++c) {
    const float sigma = vec3(0.5f, 0.2f, 0.0f)[c];
    EXPECT_NEAR(std::pow(m.attenuationColor[c], 3.0f / m.attenuationDistance),
                std::exp(-3.0f * sigma), 1e-5f);
  }
}

TEST_F(MitsubaLooks, MetalsReflectByTheirIndex) {
  const detail::ComplexIor gold = *detail::conductorNamed("Au"),
                           copper = *detail::conductorNamed("Cu");
  Material m = material(
      "<bsdf type=\"roughconductor\"><string name=\"material\" value=\"Au\"/>"
      "<float name=\"alpha\" value=\"0.04\"/><string name=\"distribution\" value=\"ggx\"/></bsdf>");
  EXPECT_EQ(m.metallic, 1.0f);
  EXPECT_NEAR(m.roughness, 0.2f, 1e-6f);
  EXPECT_FALSE(m.finish.beckmann);
  expectNear(vec3(m.baseColor), vec3(1.0f));
  expectNear(m.finish.metalEta, gold.eta);
  expectNear(m.finish.metalK, gold.k);
  m = material(
      "<bsdf type=\"roughconductor\"><rgb name=\"eta\" value=\"1.5\"/><rgb name=\"k\" value=\"2\"/>"
      "<float name=\"ext_eta\" value=\"1.25\"/>"
      "<rgb name=\"specular_reflectance\" value=\"0.5\"/></bsdf>");
  EXPECT_TRUE(m.finish.beckmann);
  expectNear(vec3(m.baseColor), vec3(0.5f));
  expectNear(m.finish.metalEta, vec3(1.2f));
  expectNear(m.finish.metalK, vec3(1.6f));
  m = material("<bsdf type=\"conductor\"/>");
  expectNear(vec3(m.baseColor), vec3(1.0f));
  EXPECT_FALSE(m.finish.present());
  expectNear(material("<bsdf type=\"conductor\"/>", "0.6.0").finish.metalK, copper.k);
  // Of a blend, whose numbers are mixed, the mean.
  m = material(
      "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"0.25\"/>"
      "<bsdf type=\"conductor\"><string name=\"material\" value=\"Cu\"/></bsdf>"
      "<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0.4\"/></bsdf></bsdf>");
  expectNear(vec3(m.baseColor), 0.75f * copper.meanReflectance() + 0.1f);
  EXPECT_FALSE(m.finish.conducts());
}

TEST_F(MitsubaLooks, PlasticKeepsItsAlbedo) {
  const Material m = material(
      "<bsdf type=\"plastic\"><float name=\"int_ior\" value=\"1.5\"/><float name=\"ext_ior\" "
      "value=\"1\"/><boolean name=\"nonlinear\" value=\"true\"/>"
      "<rgb name=\"diffuse_reflectance\" value=\"0.2, 0.5, 0.8\"/></bsdf>");
  // Inside, 0.596 of diffuse light is reflected back; 0.908 gets in, and 0.404 of it out.
  for (int c = 0; c < 3; ++c) {
    const double d = double(vec3(0.2f, 0.5f, 0.8f)[c]);
    const double albedo = 0.9082 * 0.4036 * d / (1.0 - 0.5964 * d);
    EXPECT_NEAR(m.baseColor[c] * detail::diffuseShare(1.5), albedo, 2e-3);
  }
  EXPECT_EQ(m.roughness, 0.0f);
  EXPECT_EQ(m.specular, 1.0f);
}

TEST_F(MitsubaLooks, LayersInClosedForm) {
  // Schlick's weight over the half vector of two diffuse directions lies between its value at the
  // mean and 1/21 of one direction alone.
  const double share = detail::diffuseShare(1.5);
  EXPECT_LT(share, 0.96);
  EXPECT_GT(share, 0.96 * (1.0 - 1.0 / 21.0));
  // No interface: all of the light gets in and out.
  const detail::PlasticGround bare(1.0, true);
  EXPECT_NEAR(bare.albedo(0.7), 0.7, 1e-3);
  // White without absorption: what does not get out is reflected outside.
  const detail::PlasticGround white(1.5, true);
  EXPECT_NEAR(white.albedo(1.0), 1.0 - detail::meanReflectance(1.5), 1e-3);
  // Disney's lobe without retroreflection is (1 - 0.5/21)^2 of a Lambertian one.
  EXPECT_NEAR(detail::disneyDiffuseAlbedo(0.0), std::pow(1.0 - 0.5 / 21.0, 2.0), 1e-3);
}

TEST_F(MitsubaLooks, PrincipledByItsNumbers) {
  const Material m = material(
      "<bsdf type=\"principled\"><rgb name=\"base_color\" value=\"0.5\"/>"
      "<float name=\"metallic\" value=\"1\"/><float name=\"roughness\" value=\"0.3\"/>"
      "<float name=\"clearcoat\" value=\"1\"/></bsdf>");
  EXPECT_EQ(m.metallic, 1.0f);
  EXPECT_FLOAT_EQ(m.roughness, 0.3f);
  EXPECT_NEAR(m.ior, 1.5f, 1e-5f);
  EXPECT_NEAR(m.baseColor.x, 0.5 + 0.5 / 21.0, 1e-5);  // the mean of Schlick's reflectance
}

TEST_F(MitsubaLooks, MasksCoverByTheirOpacity) {
  const Material m = material(
      "<bsdf type=\"mask\"><float name=\"opacity\" value=\"0.25\"/><bsdf "
      "type=\"diffuse\"/></bsdf>");
  EXPECT_EQ(m.alphaMode, AlphaMode::kBlend);
  EXPECT_FLOAT_EQ(m.baseColor.a, 0.25f);
}

TEST_F(MitsubaLooks, NullSurfacesAreNotThere) {
  const Scene s =
      read("<shape type=\"sphere\"><bsdf type=\"null\"/></shape><shape type=\"rectangle\"/>");
  EXPECT_EQ(s.triangleCount(), 2u);
}

TEST_F(MitsubaLooks, CheckerboardsAreFourTexels) {
  const Scene s = read(
      "<shape type=\"rectangle\"><bsdf type=\"diffuse\"><texture name=\"reflectance\" "
      "type=\"checkerboard\"><rgb name=\"color0\" value=\"0.8\"/><rgb name=\"color1\" "
      "value=\"0.1\"/><transform name=\"to_uv\"><scale x=\"4\" y=\"2\"/></transform></texture>"
      "</bsdf></shape>");
  const Texture& t = s.materials.at(0).baseColorTexture;
  const Image& image = s.images.at(t.image);
  EXPECT_TRUE(t.nearest);
  EXPECT_EQ(t.scale, vec2(4.0f, 2.0f));
  EXPECT_FLOAT_EQ(image.floats[0], 0.8f);
  EXPECT_FLOAT_EQ(image.floats[3], 0.1f);
  EXPECT_FLOAT_EQ(image.floats[6], 0.1f);
  EXPECT_FLOAT_EQ(image.floats[9], 0.8f);
}

TEST_F(MitsubaLooks, AreaLightsShineFromTheirFrontAndAreBlack) {
  const Material m =
      material("<emitter type=\"area\"><rgb name=\"radiance\" value=\"1, 20, 300\"/></emitter>");
  expectNear(m.emission, {1, 20, 300});
  expectNear(vec3(m.baseColor), vec3(0.0f));
  EXPECT_FALSE(m.doubleSided);
}

TEST_F(MitsubaLooks, LightsHaveTheirUnits) {
  const Scene s = read(
      "<emitter type=\"point\"><point name=\"position\" x=\"1\" y=\"2\" z=\"3\"/>"
      "<rgb name=\"intensity\" value=\"5, 6, 7\"/></emitter>"
      "<emitter type=\"directional\"><vector name=\"direction\" x=\"0\" y=\"-2\" z=\"0\"/>"
      "<spectrum name=\"irradiance\" value=\"3\"/></emitter>"
      "<emitter type=\"spot\"><transform name=\"to_world\"><lookat origin=\"0,4,0\" "
      "target=\"0,0,0\" up=\"0,0,1\"/></transform><float name=\"cutoff_angle\" value=\"30\"/>"
      "<float name=\"beam_width\" value=\"30\"/></emitter>");
  ASSERT_EQ(s.lights.size(), 3u);
  expectNear(vec3(s.lights[0].position), {1, 2, 3});
  expectNear(s.lights[0].intensity, {5, 6, 7});
  expectNear(s.lights[1].direction, {0, -1, 0});
  expectNear(s.lights[1].intensity, vec3(3.0f));
  expectNear(s.lights[2].direction, {0, -1, 0});
  expectNear(vec3(s.lights[2].position), {0, 4, 0});
  EXPECT_NEAR(s.lights[2].outerConeAngle, kPi / 6.0f, 1e-5f);
  EXPECT_NEAR(s.lights[2].innerConeAngle, kPi / 6.0f, 1e-2f);
}

TEST_F(MitsubaLooks, SpotsSendOutTheSamePower) {
  const Scene s = read("<emitter type=\"spot\"/>");
  const Light& l = s.lights.at(0);
  const double outer = double(l.outerConeAngle), inner = double(l.innerConeAngle);
  EXPECT_NEAR(outer, 20.0 * std::numbers::pi / 180.0, 1e-6);
  double here = 0.0, there = 0.0;
  const double beam = 0.75 * outer;
  for (double a = 0.0; a < outer; a += 1e-5) {
    const double x =
        std::clamp((std::cos(a) - std::cos(outer)) / (std::cos(inner) - std::cos(outer)), 0.0, 1.0);
    here += x * x * std::sin(a);
    there += (a < beam ? 1.0 : (outer - a) / (outer - beam)) * std::sin(a);
  }
  EXPECT_NEAR(here / there, 1.0, 1e-3);
}

TEST_F(MitsubaLooks, SkiesAndBlackBodies) {
  Scene s =
      read("<emitter type=\"constant\"><rgb name=\"radiance\" value=\"0.5, 1, 2\"/></emitter>");
  expectNear(s.environment.color, {0.5f, 1, 2});
  s = read(
      "<emitter type=\"constant\"><blackbody name=\"radiance\" temperature=\"3000K\" "
      "scale=\"0.001\"/></emitter>");
  EXPECT_NEAR(s.environment.color.x, 0.733f, 0.008f);
}

/// A map of 4 by 2 texels, red in the middle of Mitsuba's directions +z.
TEST_F(MitsubaLooks, EnvironmentMapsAreTurned) {
  std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n";
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 4; ++x) hdr += std::string({char(128), char(16 * x), 0, char(129)});
  }
  write("sky.hdr", hdr);
  const std::string map =
      "<emitter type=\"envmap\"><string name=\"filename\" value=\"sky.hdr\"/>"
      "<float name=\"scale\" value=\"3\"/>";
  Scene s = read(map + "</emitter>");
  ASSERT_NE(s.environment.map, nullptr);
  EXPECT_NEAR(s.environment.rotation, kPi, 1e-6f);
  expectNear(s.environment.color, vec3(3.0f));
  // Turned by 90 degrees about y, what was at +z is at +x, which is a quarter clockwise from -z.
  s = read(map +
           "<transform name=\"to_world\"><rotate y=\"1\" angle=\"90\"/></transform></emitter>");
  const float turn =
      s.environment.rotation - 2.0f * kPi * std::floor(s.environment.rotation / (2.0f * kPi));
  EXPECT_NEAR(turn, 1.5f * kPi, 1e-5f);
  s = read(map +
           "<transform name=\"to_world\"><rotate x=\"1\" angle=\"90\"/></transform></emitter>");
  EXPECT_NEAR(s.environment.rotation, kPi, 1e-6f);
}

TEST_F(MitsubaLooks, SunAndSkyAreNamedAndLikeTheirs) {
  const std::string text =
      "<emitter type=\"sunsky\"><float name=\"turbidity\" value=\"3\"/>"
      "<vector name=\"sun_direction\" x=\"0\" y=\"1\" z=\"1\"/></emitter>";
  Scene s = read(text);  // z is up
  ASSERT_EQ(s.lights.size(), 1u);
  expectNear(s.lights[0].direction, glm::normalize(vec3(0, -1, -1)));
  EXPECT_NEAR(s.lights[0].intensity.y, 1.2f, 0.1f);
  ASSERT_NE(s.environment.map, nullptr);
  EXPECT_TRUE(says(s.replaced.texts, "sunsky"));
  // A sun of some degrees is a disk in the sky.
  s = read("<emitter type=\"sunsky\"><float name=\"sunRadiusScale\" value=\"10\"/></emitter>", {},
           "0.6.0");
  EXPECT_TRUE(s.lights.empty());
}

}  // namespace
}  // namespace trex::test
