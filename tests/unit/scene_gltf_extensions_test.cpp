// glTF: instances, skins, morph targets, animations, variants, scenes, samplers, sets of texture
// coordinates, compressed geometry.
#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <meshoptimizer.h>

#include "src/scene/scene_json.h"
#include "src/scene/texture.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneGltfMore : public SceneTest {
 protected:
  std::string refused(const GlbBuilder& builder, const ImportOptions& options, ExitCode code) {
    GlbBuilder b = builder;
    try {
      import("bad.glb", b.glb(), options);
      ADD_FAILURE() << "was accepted";
      return {};
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), code) << e.what();
      return e.what();
    }
  }
};

const std::vector<float> kSquare = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
const std::vector<std::uint16_t> kIndices = {0, 1, 2, 0, 2, 3};

/// A square of 2 m in mesh 0, without a node.
GlbBuilder squareGlb(float scale = 1.0f) {
  GlbBuilder b;
  std::vector<float> p = kSquare;
  for (float& f : p) f *= scale;
  const int positions = b.floats(p);
  const int indices = b.accessor(kIndices, 5123, "SCALAR", kIndices.size());
  b.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", indices}});
  return b;
}

json& primitive(GlbBuilder& b) { return b.doc["meshes"][0]["primitives"][0]; }

void expectBox(const Scene& s, const dvec3& lower, const dvec3& upper, const char* what) {
  const Box3d box = s.bounds();
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(box.lower[k], lower[k], 1e-6) << what << " " << k;
    EXPECT_NEAR(box.upper[k], upper[k], 1e-6) << what << " " << k;
  }
}

TEST_F(SceneGltfMore, HiddenNodesAndWhatIsBelowThem) {
  GlbBuilder b = squareGlb();
  const auto seen = [](bool visible) {
    return json{{"KHR_node_visibility", {{"visible", visible}}}};
  };
  b.doc["nodes"] = {{{"mesh", 0}, {"extensions", seen(true)}},
                    {{"children", {2, 3}}, {"translation", {0, 0, 5}}, {"extensions", seen(false)}},
                    {{"mesh", 0}, {"extensions", seen(true)}},
                    {{"camera", 0}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}}};
  b.doc["scenes"] = {{{"nodes", {0, 1}}}};
  b.doc["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 0.1}}}}};
  b.doc["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
  b.doc["extensionsRequired"] = {"KHR_node_visibility"};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.instances.size(), 1u);
  EXPECT_TRUE(s.lights.empty());
  ASSERT_EQ(s.cameras.size(), 1u);
  EXPECT_EQ(s.cameras[0].eye, dvec3(0, 0, 5));  // which nobody sees anyway
  EXPECT_EQ(s.replaced.count, 0u);
}

TEST_F(SceneGltfMore, GpuInstances) {
  GlbBuilder b = squareGlb();
  const int t = b.floats({0, 0, 0, 10, 0, 0, 0, 0, 5});
  const int r = b.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, std::sqrt(0.5f), 0, std::sqrt(0.5f)}, "VEC4");
  const int scale = b.floats({1, 1, 1, 2, 2, 2, 1, 1, 1});
  json node = {{"mesh", 0},
               {"translation", {0, 100, 0}},
               {"extensions",
                {{"EXT_mesh_gpu_instancing",
                  {{"attributes", {{"TRANSLATION", t}, {"ROTATION", r}, {"SCALE", scale}}}}}}}};
  b.node(node);
  b.doc["extensionsRequired"] = b.doc["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
  const Scene s = import("a.glb", b.glb());
  ASSERT_EQ(s.instances.size(), 3u);
  EXPECT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_EQ(s.instances[1].transform[0][0], 2.0);
  EXPECT_EQ(dvec3(s.instances[1].transform[3]), dvec3(10, 100, 0));
  expectBox(s, {-1, 98, -2 + 2}, {12, 102, 6}, "instances");
  for (const json& bad : {json{{"TRANSLATION", 99}}, json{{"TRANSLATION", r}}, json::object(),
                          json{{"TRANSLATION", t}, {"SCALE", b.floats({1, 1, 1})}}}) {
    GlbBuilder wrong = b;
    wrong.doc["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = bad;
    const Scene one = import("b.glb", wrong.glb());
    EXPECT_EQ(one.instances.size(), 1u);
    EXPECT_EQ(one.replaced.count, 1u);
  }
}

/// A skin of one joint for all vertices.
void addSkin(GlbBuilder& b, const json& joints, const std::vector<float>& inverse = {}) {
  primitive(b)["attributes"]["JOINTS_0"] =
      b.accessor(std::vector<std::uint8_t>(16, 0), 5121, "VEC4", 4);
  primitive(b)["attributes"]["WEIGHTS_0"] =
      b.floats({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  b.doc["skins"] = {{{"joints", joints}}};
  if (!inverse.empty()) {
    b.doc["skins"][0]["inverseBindMatrices"] = b.accessor(inverse, 5126, "MAT4", 1);
  }
}

/// The joints place a skinned mesh; the nodes above it do not.
TEST_F(SceneGltfMore, SkinsIgnoreTheirNode) {
  GlbBuilder b = squareGlb();
  b.node({{"name", "joint"}});
  b.node({{"scale", {0.2, 0.2, 0.2}}, {"translation", {1, 0, 0}}, {"children", {2}}});
  b.doc["nodes"].push_back({{"mesh", 0}, {"skin", 0}, {"translation", {0, 1.5, 0}}});
  addSkin(b, {0});
  const Scene square = import("a.glb", b.glb());
  expectBox(square, {-1, -1, 0}, {1, 1, 0}, "square");
  EXPECT_EQ(square.replaced.count, 0u);
  // An armature of a hundredth over a mesh in centimetres.
  GlbBuilder c = squareGlb(100.0f);
  c.node({{"scale", {0.01, 0.01, 0.01}}, {"children", {1}}});
  c.doc["nodes"].push_back({{"name", "joint"}});
  c.node({{"mesh", 0}, {"skin", 0}});
  addSkin(c, {1});
  expectBox(import("c.glb", c.glb()), {-1, -1, 0}, {1, 1, 0}, "centimetres");
  // What the joint moved since it was bound moves the mesh.
  GlbBuilder d = squareGlb();
  d.node({{"translation", {5, 0, 0}}});
  d.node({{"mesh", 0}, {"skin", 0}});
  addSkin(d, {0}, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -2, 0, 0, 1});
  const Scene s = import("d.glb", d.glb());
  expectBox(s, {2, -1, 0}, {4, 1, 0}, "bound");
  EXPECT_EQ(s.replaced.count, 0u);
  // A joint that is not there: unbent, and said.
  d.doc["skins"][0]["joints"] = {77};
  const Scene broken = import("e.glb", d.glb());
  EXPECT_TRUE(anyReplaced(broken, "joint 77"));
  expectBox(broken, {-1, -1, 0}, {1, 1, 0}, "broken");
}

/// Half the weight of each of two joints is the mean of where they put a vertex.
TEST_F(SceneGltfMore, SkinsBlend) {
  GlbBuilder b = squareGlb();
  b.node({{"translation", {4, 0, 0}}});
  b.node({{"translation", {0, 2, 0}}});
  b.node({{"mesh", 0}, {"skin", 0}});
  primitive(b)["attributes"]["JOINTS_0"] = b.accessor(
      std::vector<std::uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}, 5121, "VEC4", 4);
  primitive(b)["attributes"]["WEIGHTS_0"] = b.accessor(
      std::vector<std::uint8_t>{128, 128, 0, 0, 128, 128, 0, 0, 128, 128, 0, 0, 128, 128, 0, 0},
      5121, "VEC4", 4, true);
  b.doc["skins"] = {{{"joints", {0, 1}}}};
  expectBox(import("a.glb", b.glb()), {1, 0, 0}, {3, 2, 0}, "blend");
}

void addMorph(GlbBuilder& b) {
  primitive(b)["targets"] = {{{"POSITION", b.floats({0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0})}}};
}

TEST_F(SceneGltfMore, MorphTargetsByDefaultWeights) {
  GlbBuilder b = squareGlb();
  addMorph(b);
  b.node({{"mesh", 0}});
  expectBox(import("a.glb", b.glb()), {-1, -1, 0}, {1, 1, 0}, "none");
  b.doc["meshes"][0]["weights"] = {1.0};
  expectBox(import("a.glb", b.glb()), {-1, -1, 0}, {1, 2, 0}, "mesh");
  b.doc["nodes"][0]["weights"] = {0.5};
  expectBox(import("a.glb", b.glb()), {-1, -1, 0}, {1, 1.5, 0}, "node");
  // Two nodes with weights of their own.
  b.node({{"mesh", 0}, {"weights", {0.0}}, {"translation", {10, 0, 0}}});
  const Scene two = import("a.glb", b.glb());
  EXPECT_EQ(two.meshes.size(), 2u);
}

TEST_F(SceneGltfMore, AnimationsAtAMoment) {
  GlbBuilder b = squareGlb();
  addMorph(b);
  b.node({{"mesh", 0}});
  const int times = b.floats({1, 3}, "SCALAR");
  const int places = b.floats({0, 0, 0, 8, 0, 0});
  const int weights = b.floats({0, 1}, "SCALAR");
  // In-tangent, value, out-tangent of each key: a Hermite curve from 0 to 8 that leaves at 4 a
  // second and arrives at 0.
  const int curve = b.floats({0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0});
  const float h = std::sqrt(0.5f);
  const int turns = b.floats({0, 0, 0, 1, 0, 0, h, h}, "VEC4");
  const auto sampler = [&](int output, const char* interpolation) {
    return json{{"input", times}, {"output", output}, {"interpolation", interpolation}};
  };
  b.doc["animations"] = json::array();
  const auto add = [&](const char* name, const json& s, const char* path) {
    b.doc["animations"].push_back(
        {{"name", name},
         {"samplers", json::array({s})},
         {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", path}}}}}}});
  };
  add("slide", sampler(places, "LINEAR"), "translation");
  add("jump", sampler(places, "STEP"), "translation");
  add("curve", sampler(curve, "CUBICSPLINE"), "translation");
  add("grow", sampler(weights, "LINEAR"), "weights");
  add("turn", sampler(turns, "LINEAR"), "rotation");
  const auto at = [&](const char* name, double seconds) {
    ImportOptions options;
    options.animation = name;
    options.atSeconds = seconds;
    return import("a.glb", b.glb(), options);
  };
  for (const auto& [name, seconds, x] : {std::tuple("slide", 0.0, 0.0),
                                         {"slide", 1.5, 2.0},
                                         {"0", 2.0, 4.0},
                                         {"slide", 9.0, 8.0},
                                         {"jump", 2.99, 0.0},
                                         {"jump", 3.0, 8.0},
                                         {"curve", 1.0, 0.0},
                                         // Of the Hermite basis at a half: 8/2 + 2 * 4/8.
                                         {"curve", 2.0, 5.0},
                                         {"curve", 3.5, 8.0}}) {
    expectBox(at(name, seconds), {x - 1, -1, 0}, {x + 1, 1, 0}, name);
  }
  expectBox(at("grow", 2.0), {-1, -1, 0}, {1, 1.5, 0}, "grow");
  const double r = std::sqrt(2.0);  // a square turned by 45 degrees
  expectBox(at("turn", 2.0), {-r, -r, 0}, {r, r, 0}, "turn");
  ImportOptions wrong;
  wrong.animation = "walk";
  EXPECT_NE(refused(b, wrong, ExitCode::kUsage).find("slide"), std::string::npos);
}

TEST_F(SceneGltfMore, VariantsAndScenesByNameOrNumber) {
  GlbBuilder b = squareGlb();
  b.doc["materials"] = {{{"name", "plain"}}, {{"name", "red"}}, {{"name", "blue"}}};
  primitive(b)["material"] = 0;
  primitive(b)["extensions"]["KHR_materials_variants"]["mappings"] = {
      {{"material", 1}, {"variants", {0}}}, {{"material", 2}, {"variants", {1, 2}}}};
  b.doc["extensions"]["KHR_materials_variants"]["variants"] = {
      {{"name", "ruby"}}, {{"name", "sea"}}, {{"name", "sky"}}};
  b.doc["extensionsUsed"] = {"KHR_materials_variants"};
  b.node({{"mesh", 0}});
  b.doc["nodes"].push_back({{"mesh", 0}, {"translation", {9, 0, 0}}});
  b.doc["scenes"].push_back({{"name", "other"}, {"nodes", {1}}});
  const auto material = [&](const std::string& variant) {
    const Scene s = import("a.glb", b.glb(), {.variant = variant});
    return s.materials[s.meshes[0].material].name;
  };
  EXPECT_EQ(material(""), "plain");
  EXPECT_EQ(material("ruby"), "red");
  EXPECT_EQ(material("sky"), "blue");
  EXPECT_EQ(material("1"), "blue");
  EXPECT_NE(refused(b, {.variant = "mud"}, ExitCode::kUsage).find("ruby, sea, sky"),
            std::string::npos);
  EXPECT_EQ(import("a.glb", b.glb()).bounds().lower.x, -1.0);
  EXPECT_EQ(import("a.glb", b.glb(), {.scene = "other"}).bounds().lower.x, 8.0);
  EXPECT_EQ(import("a.glb", b.glb(), {.scene = "1"}).bounds().lower.x, 8.0);
  EXPECT_NE(refused(b, {.scene = "none"}, ExitCode::kUsage).find("other"), std::string::npos);
}

/// A material with a texture of each set.
GlbBuilder twoSets(const std::vector<float>& second) {
  GlbBuilder b = squareGlb();
  const std::vector<float> first = {0, 1, 1, 1, 1, 0, 0, 0};
  primitive(b)["attributes"]["TEXCOORD_0"] = b.floats(first, "VEC2");
  primitive(b)["attributes"]["TEXCOORD_1"] = b.floats(second, "VEC2");
  primitive(b)["material"] = 0;
  b.doc["images"] = {{{"uri", "data:image/png;base64," + base64(tinyPng())}}};
  b.doc["samplers"] = {{{"magFilter", 9728}, {"wrapS", 33071}, {"wrapT", 33648}}};
  b.doc["textures"] = {{{"source", 0}, {"sampler", 0}}};
  const json moved = {{"index", 0},
                      {"texCoord", 1},
                      {"extensions",
                       {{"KHR_texture_transform",
                         {{"offset", {0.5, 0.25}}, {"rotation", 0.5}, {"scale", {2, 3}}}}}}};
  b.doc["materials"] = {{{"emissiveFactor", {1, 1, 1}},
                         {"emissiveTexture", moved},
                         {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  b.node({{"mesh", 0}});
  return b;
}

TEST_F(SceneGltfMore, ASecondSetThatIsTheFirstScaledAndShifted) {
  const std::vector<float> second = {0.1f, 0.3f, 0.3f, 0.3f, 0.3f, 0.1f, 0.1f, 0.1f};
  const Scene s = import("a.glb", twoSets(second).glb());
  EXPECT_EQ(s.replaced.count, 0u);
  const Mesh& mesh = s.meshes[0];
  const Material& m = s.materials[mesh.material];
  Texture asWritten = m.emissiveTexture;
  asWritten.offset = {0.5f, 0.25f};
  asWritten.scale = {2.0f, 3.0f};
  for (std::size_t v = 0; v < 4; ++v) {
    const vec2 wanted = transformUv(asWritten, {second[2 * v], second[2 * v + 1]});
    const vec2 got = transformUv(m.emissiveTexture, mesh.texCoords[v]);
    EXPECT_NEAR(got.x, wanted.x, 1e-5f);
    EXPECT_NEAR(got.y, wanted.y, 1e-5f);
  }
  EXPECT_EQ(m.baseColorTexture.scale, vec2(1));
  const Scene other = import("b.glb", twoSets({0, 0, 0.5f, 0.1f, 1, 1, 0, 0.2f}).glb());
  EXPECT_EQ(other.replaced.count, 0u);
  EXPECT_EQ(other.meshes[0].secondTexCoords[1], vec2(0.5f, 0.1f));
  EXPECT_EQ(other.materials[other.meshes[0].material].emissiveTexture.set, 1);
}

TEST_F(SceneGltfMore, SamplersOfTheNearestTexelAndTheirWraps) {
  const Scene s = import("a.glb", twoSets({0, 1, 1, 1, 1, 0, 0, 0}).glb());
  const Texture& t = s.materials[s.meshes[0].material].baseColorTexture;
  EXPECT_TRUE(t.nearest);
  EXPECT_EQ(t.wrapS, Texture::Wrap::kClamp);
  EXPECT_EQ(t.wrapT, Texture::Wrap::kMirror);
  const auto at = [&](float u, float v) { return sampleTexture(s.images[0], t, {u, v}, true); };
  EXPECT_EQ(at(0.49f, 0.49f), vec4(1, 0, 0, 1));
  EXPECT_EQ(at(0.51f, 0.49f), vec4(0, 1, 0, 1));
  EXPECT_EQ(at(0.01f, 0.51f), vec4(0, 0, 1, 1));
  EXPECT_EQ(at(0.99f, 0.99f), vec4(1));
  EXPECT_EQ(at(5.0f, 1.4f), vec4(1));            // clamped; mirrored to 0.6
  EXPECT_EQ(at(-1.0f, 1.6f), vec4(1, 0, 0, 1));  // mirrored to 0.4
}

TEST_F(SceneGltfMore, SpecularGlossiness) {
  GlbBuilder b = squareGlb();
  primitive(b)["material"] = 0;
  b.doc["materials"] = {{{"extensions",
                          {{"KHR_materials_pbrSpecularGlossiness",
                            {{"diffuseFactor", {0.8, 0.1, 0.2, 1.0}},
                             {"specularFactor", {0.04, 0.04, 0.04}},
                             {"glossinessFactor", 0.25}}}}}}};
  b.doc["extensionsUsed"] = b.doc["extensionsRequired"] = {"KHR_materials_pbrSpecularGlossiness"};
  b.node({{"mesh", 0}});
  const Scene s = import("a.glb", b.glb());
  const Material& m = s.materials[s.meshes[0].material];
  EXPECT_EQ(m.baseColor, vec4(0.8f, 0.1f, 0.2f, 1.0f));
  EXPECT_EQ(m.metallic, 0.0f);
  EXPECT_FLOAT_EQ(m.roughness, 0.75f);
  EXPECT_FLOAT_EQ(m.specularColor.x, 1.0f);
  EXPECT_EQ(s.replaced.count, 0u);
}

/// The alpha of its texture is glossiness: here 1 and 0.2, of which the factor leaves half.
TEST_F(SceneGltfMore, SpecularGlossinessTexture) {
  const std::string head("\0\0\2\0\0\0\0\0\0\0\0\0\2\0\1\0\x20\x28", 18);  // 2x1, 32 bits
  const std::string colors("\xff\xff\xff\xff\x80\x80\x80\x33", 8);
  for (const std::string& texels : {head + colors, tinyPng(), std::string("broken")}) {
    GlbBuilder b = squareGlb();
    primitive(b)["material"] = 0;
    primitive(b)["attributes"]["TEXCOORD_0"] = b.floats({0, 1, 1, 1, 1, 0, 0, 0}, "VEC2");
    b.doc["images"] = {{{"uri", "data:image/png;base64," + base64(texels)}}};
    b.doc["textures"] = {{{"source", 0}}};
    b.doc["materials"] = {
        {{"extensions",
          {{"KHR_materials_pbrSpecularGlossiness",
            {{"glossinessFactor", 0.5}, {"specularGlossinessTexture", {{"index", 0}}}}}}}}};
    b.doc["extensionsUsed"] = {"KHR_materials_pbrSpecularGlossiness"};
    b.node({{"mesh", 0}});
    const Scene s = import("a.glb", b.glb());
    const Material& m = s.materials[s.meshes[0].material];
    const bool broken = texels == "broken", alpha = texels.size() == head.size() + colors.size();
    EXPECT_EQ(s.replaced.count, broken ? 1u : 0u)
        << (s.replaced.texts.empty() ? "" : s.replaced.texts[0]);
    ASSERT_TRUE(m.metallicRoughnessTexture.present());
    EXPECT_EQ(m.specularColorTexture.present(), !broken);
    Texture t = m.metallicRoughnessTexture;
    t.nearest = true;
    const auto roughness = [&](float u) {
      return m.roughness * sampleTexture(s.images[t.image], t, {u, 0.5f}, false).y;
    };
    EXPECT_NEAR(roughness(0.25f), 0.5f, 0.003f);
    EXPECT_NEAR(roughness(0.75f), alpha ? 0.9f : 0.5f, 0.003f);
    EXPECT_EQ(m.metallic, 0.0f);
  }
}

/// The scale of the coat's own normals.
TEST_F(SceneGltfMore, NormalsOfCoatsAreScaled) {
  GlbBuilder b = squareGlb();
  primitive(b)["material"] = 0;
  primitive(b)["attributes"]["TEXCOORD_0"] = b.floats({0, 1, 1, 1, 1, 0, 0, 0}, "VEC2");
  b.doc["images"] = {{{"uri", "data:image/png;base64," + base64(tinyPng())}}};
  b.doc["textures"] = {{{"source", 0}}};
  b.doc["materials"] = {{{"extensions",
                          {{"KHR_materials_clearcoat",
                            {{"clearcoatFactor", 1.0},
                             {"clearcoatNormalTexture", {{"index", 0}, {"scale", 0.5}}}}}}}}};
  b.node({{"mesh", 0}});
  const Scene s = import("a.glb", b.glb());
  const Finish& f = s.materials[s.meshes[0].material].finish;
  EXPECT_EQ(f.clearcoatNormalScale, 0.5f);
  EXPECT_TRUE(f.clearcoatNormalTexture.present());
  EXPECT_EQ(materialJson(s.materials[0]).at("clearcoat_normal_scale"), 0.5);
}

/// Normal maps lie along their textures; tangents that say otherwise are told of.
TEST_F(SceneGltfMore, TangentsThatAreNotAlongTheTexture) {
  const auto said = [&](const std::vector<float>& tangent, bool normalMap = true) {
    GlbBuilder b = squareGlb();
    primitive(b)["material"] = 0;
    primitive(b)["attributes"]["TEXCOORD_0"] = b.floats({0, 1, 1, 1, 1, 0, 0, 0}, "VEC2");
    std::vector<float> all;
    for (int i = 0; i < 4; ++i) all.insert(all.end(), tangent.begin(), tangent.end());
    primitive(b)["attributes"]["TANGENT"] = b.floats(all, "VEC4");
    b.doc["images"] = {{{"uri", "data:image/png;base64," + base64(tinyPng())}}};
    b.doc["textures"] = {{{"source", 0}}};
    b.doc["materials"] = {{{normalMap ? "normalTexture" : "emissiveTexture", {{"index", 0}}}}};
    b.node({{"mesh", 0}});
    return anyReplaced(import("a.glb", b.glb()), "tangents of 100 %");
  };
  EXPECT_FALSE(said({1, 0, 0, 1}));
  EXPECT_FALSE(said({0.8f, 0.3f, 0, 1}));
  EXPECT_TRUE(said({-1, 0, 0, 1}));
  EXPECT_TRUE(said({0, 1, 0, 1}));
  EXPECT_TRUE(said({1, 0, 0, -1}));
  EXPECT_FALSE(said({0, 1, 0, 1}, false));
  EXPECT_FALSE(said({0, 0, 0, 0}));
}

TEST_F(SceneGltfMore, Finishes) {
  GlbBuilder b = squareGlb();
  b.doc["materials"] = {
      {{"extensions",
        {{"KHR_materials_clearcoat",
          {{"clearcoatFactor", 0.5}, {"clearcoatRoughnessFactor", 0.25}}},
         {"KHR_materials_sheen",
          {{"sheenColorFactor", {0.1, 0.2, 0.3}}, {"sheenRoughnessFactor", 0.4}}},
         {"KHR_materials_anisotropy", {{"anisotropyStrength", 0.6}, {"anisotropyRotation", 1.5}}},
         {"KHR_materials_iridescence",
          {{"iridescenceFactor", 1.5},
           {"iridescenceIor", 1.8},
           {"iridescenceThicknessMaximum", 900}}}}}}};
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  b.doc["extensionsUsed"] = {"KHR_materials_clearcoat", "KHR_materials_sheen",
                             "KHR_materials_anisotropy", "KHR_materials_iridescence"};
  b.node({{"mesh", 0}});
  const Scene s = import("a.glb", b.glb());
  EXPECT_TRUE(s.warnings.empty() || !anyWarning(s, "KHR_materials"));
  Finish right;
  right.clearcoat = 0.5f, right.clearcoatRoughness = 0.25f;
  right.sheenColor = vec3(0.1f, 0.2f, 0.3f), right.sheenRoughness = 0.4f;
  right.anisotropy = 0.6f, right.anisotropyRotation = 1.5f;
  right.iridescence = 1.0f, right.iridescenceIor = 1.8f, right.iridescenceThickest = 900.0f;
  EXPECT_EQ(s.materials[s.meshes[0].material].finish, right);
  EXPECT_TRUE(anyReplaced(s, "iridescenceFactor"));
}

TEST_F(SceneGltfMore, RequiredExtensionsThatDoNotMoveTheGeometry) {
  for (const auto& [name, fine] : {std::pair("KHR_materials_diffuse_transmission", true),
                                   {"KHR_texture_basisu", true},
                                   {"KHR_xmp_json_ld", true},
                                   {"CESIUM_RTC", false},
                                   {"KHR_meshopt_compression", false}}) {
    GlbBuilder b = squareGlb();
    b.node({{"mesh", 0}});
    b.doc["extensionsRequired"] = b.doc["extensionsUsed"] = {name};
    if (fine) {
      EXPECT_TRUE(anyReplaced(import("a.glb", b.glb()), name)) << name;
    } else {
      EXPECT_NE(refused(b, {}, ExitCode::kInput).find(name), std::string::npos);
    }
  }
}

/// The square through meshopt's codecs, in a fallback buffer that has no bytes.
GlbBuilder meshoptGlb() {
  std::vector<unsigned char> vertices(meshopt_encodeVertexBufferBound(4, 12));
  vertices.resize(
      meshopt_encodeVertexBuffer(vertices.data(), vertices.size(), kSquare.data(), 4, 12));
  const std::vector<unsigned> wide(kIndices.begin(), kIndices.end());
  std::vector<unsigned char> indices(meshopt_encodeIndexBufferBound(wide.size(), 4));
  indices.resize(
      meshopt_encodeIndexBuffer(indices.data(), indices.size(), wide.data(), wide.size()));
  GlbBuilder b;
  const std::size_t at = (vertices.size() + 3) / 4 * 4;
  b.bin = bytesOf(vertices);
  b.bin.resize(at);
  b.bin += bytesOf(indices);
  const json fallback = {{"EXT_meshopt_compression", {{"fallback", true}}}};
  b.doc["buffers"] = {{{"byteLength", b.bin.size()}},
                      {{"byteLength", 60}, {"extensions", fallback}}};
  const auto view = [&](int offset, int length, json extension) {
    extension["buffer"] = 0;
    b.doc["bufferViews"].push_back({{"buffer", 1},
                                    {"byteOffset", offset},
                                    {"byteLength", length},
                                    {"extensions", {{"EXT_meshopt_compression", extension}}}});
  };
  view(0, 48,
       {{"byteLength", vertices.size()}, {"byteStride", 12}, {"count", 4}, {"mode", "ATTRIBUTES"}});
  view(48, 12,
       {{"byteOffset", at},
        {"byteLength", indices.size()},
        {"byteStride", 2},
        {"count", 6},
        {"mode", "TRIANGLES"}});
  b.doc["accessors"] = {
      {{"bufferView", 0}, {"componentType", 5126}, {"type", "VEC3"}, {"count", 4}},
      {{"bufferView", 1}, {"componentType", 5123}, {"type", "SCALAR"}, {"count", 6}}};
  b.mesh({{"attributes", {{"POSITION", 0}}}, {"indices", 1}});
  b.node({{"mesh", 0}});
  b.doc["extensionsUsed"] = b.doc["extensionsRequired"] = {"EXT_meshopt_compression"};
  return b;
}

TEST_F(SceneGltfMore, MeshoptIsThePlainMesh) {
  GlbBuilder b = meshoptGlb();
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.replaced.count, 0u);
  ASSERT_EQ(s.meshes.size(), 1u);
  EXPECT_EQ(s.triangleCount(), 2u);
  expectBox(s, {-1, -1, 0}, {1, 1, 0}, "meshopt");
  GlbBuilder plain = squareGlb();
  plain.node({{"mesh", 0}});
  EXPECT_EQ(s.meshes[0].positions, import("b.glb", plain.glb()).meshes[0].positions);
}

/// Lies of the extension are errors that name the view, and take no memory.
TEST_F(SceneGltfMore, MeshoptThatLies) {
  for (const auto& [key, value] : {std::pair<std::string, json>{"count", 2000000000},
                                   {"byteStride", 2000},
                                   {"byteStride", 0},
                                   {"mode", "TRIANGLES"},
                                   {"mode", "NONE"},
                                   {"filter", "QUATERNION"},
                                   {"filter", "CUBE"},
                                   {"byteLength", 3},
                                   {"byteLength", 100000},
                                   {"byteOffset", 1000},
                                   {"buffer", 7}}) {
    GlbBuilder b = meshoptGlb();
    b.doc["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value;
    EXPECT_NE(refused(b, {}, ExitCode::kInput), "") << key << value;
  }
}

/// The square through draco's codec.
GlbBuilder dracoGlb() {
  draco::TriangleSoupMeshBuilder soup;
  soup.Start(2);
  const int positions = soup.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  for (int face = 0; face < 2; ++face) {
    const float* p[3];
    for (int k = 0; k < 3; ++k)
      p[k] = &kSquare[std::size_t(3 * kIndices[std::size_t(3 * face + k)])];
    soup.SetAttributeValuesForFace(positions, draco::FaceIndex(face), p[0], p[1], p[2]);
  }
  const std::unique_ptr<draco::Mesh> mesh = soup.Finalize();
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 14);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  GlbBuilder b;
  const int view = b.view(std::string(buffer.data(), buffer.size()));
  b.doc["accessors"] = {{{"componentType", 5126}, {"type", "VEC3"}, {"count", 4}},
                        {{"componentType", 5123}, {"type", "SCALAR"}, {"count", 6}}};
  b.mesh({{"attributes", {{"POSITION", 0}}},
          {"indices", 1},
          {"extensions",
           {{"KHR_draco_mesh_compression",
             {{"bufferView", view},
              {"attributes", {{"POSITION", mesh->attribute(0)->unique_id()}}}}}}}});
  b.node({{"mesh", 0}});
  b.doc["extensionsUsed"] = b.doc["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  return b;
}

/// Equal but for the quantisation: 2 m in 2^14 - 1 steps.
TEST_F(SceneGltfMore, DracoIsThePlainMesh) {
  GlbBuilder b = dracoGlb();
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_EQ(s.triangleCount(), 2u);
  for (const vec3& p : s.meshes[0].positions) {
    EXPECT_NEAR(std::abs(p.x), 1.0f, 2.0f / 16383.0f);
    EXPECT_NEAR(std::abs(p.y), 1.0f, 2.0f / 16383.0f);
  }
  for (const auto& [key, value] : {std::pair<std::string, json>{"bufferView", 9},
                                   {"attributes", 5},
                                   {"attributes", {{"POSITION", 44}}}}) {
    GlbBuilder wrong = dracoGlb();
    primitive(wrong)["extensions"]["KHR_draco_mesh_compression"][key] = value;
    EXPECT_NE(refused(wrong, {}, ExitCode::kInput), "") << key;
  }
  for (std::size_t i = 0; i < b.bin.size(); ++i) {
    GlbBuilder flipped = b;
    flipped.bin[i] = static_cast<char>(flipped.bin[i] ^ 0x15);
    try {
      import("c.glb", flipped.glb());
    } catch (const Error&) {
    }
  }
}

}  // namespace
}  // namespace trex::test
