// One broken part does not refuse a model: the rest is shown, and Scene::replaced names the part.
#include <functional>

#include "src/scene/import_detail.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneReplaced : public SceneTest {
 protected:
  /// The file is read, says so of the part, and shows `triangles`; with `strict` it is refused.
  Scene expectReplaced(const std::string& what, const std::string& file, const std::string& bytes,
                       const std::string& message, std::uint64_t triangles = 1) {
    const std::filesystem::path path = write(file, bytes);
    Scene scene;
    try {
      scene = importScene(path);
    } catch (const Error& e) {
      ADD_FAILURE() << what << ": refused: " << e.what();
      return scene;
    }
    EXPECT_EQ(scene.triangleCount(), triangles) << what;
    EXPECT_GE(scene.replaced.count, 1u) << what;
    EXPECT_TRUE(anyReplaced(scene, message)) << what << ": " << said(scene);
    for (const std::string& text : scene.replaced.texts) {
      EXPECT_NE(text.find(folder_.string()), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    }
    try {
      importScene(path, {.strict = true});
      ADD_FAILURE() << what << ": accepted with strict";
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput) << what;
      EXPECT_NE(std::string(e.what()).find("--strict"), std::string::npos) << e.what();
    }
    return scene;
  }
  static std::string said(const Scene& scene) {
    std::string all;
    for (const std::string& text : scene.replaced.texts) all += text + "\n";
    return all;
  }
};

/// Gives the triangle's material a base colour texture of an image.
void addTexture(json& d, const json& image) {
  d["images"] = json::array({image});
  d["textures"] = {{{"source", 0}}};
  d["materials"] = {
      {{"pbrMetallicRoughness",
        {{"baseColorFactor", {0.25, 0.5, 0.75, 1.0}}, {"baseColorTexture", {{"index", 0}}}}}}};
  d["meshes"][0]["primitives"][0]["material"] = 0;
}

TEST_F(SceneReplaced, GltfShowsTheFactorOfAMissingTexture) {
  const std::string broken = "data:image/png;base64," + base64("\x89PNGbroken");
  for (const auto& [uri, message] : {std::pair<std::string, std::string>{"gone.png", "gone.png"},
                                     {broken, "image 0"},
                                     {"https://example.com/a.png", "only files"}}) {
    GlbBuilder b = triangleGlb();
    addTexture(b.doc, {{"uri", uri}});
    const Scene s = expectReplaced(message, "a.glb", b.glb(), message);
    ASSERT_EQ(s.meshes.size(), 1u);
    const Material& m = s.materials[s.meshes[0].material];
    EXPECT_FALSE(m.textured());
    EXPECT_EQ(m.baseColor, vec4(0.25f, 0.5f, 0.75f, 1.0f));
    EXPECT_TRUE(s.images.empty());
  }
}

TEST_F(SceneReplaced, GltfImagesThatAreGoodStay) {
  write("good.png", tinyPng());
  GlbBuilder b = triangleGlb();
  b.doc["images"] = {{{"uri", "gone.png"}}, {{"uri", "good.png"}}};
  b.doc["textures"] = {{{"source", 0}}, {{"source", 1}}};
  b.doc["materials"] = {{{"normalTexture", {{"index", 0}}},
                         {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 1}}}}}}};
  b.doc["meshes"][0]["primitives"][0]["material"] = 0;
  const Scene s = expectReplaced("two", "a.glb", b.glb(), "gone.png");
  ASSERT_EQ(s.images.size(), 1u);
  EXPECT_EQ(s.images[0].width, 2);
  EXPECT_EQ(s.materials[0].baseColorTexture.image, 0);
  EXPECT_FALSE(s.materials[0].normalTexture.present());
}

TEST_F(SceneReplaced, GltfParts) {
  struct Case {
    const char* what;
    std::function<void(json&)> change;
    const char* message;
    std::uint64_t triangles = 1;
  };
  const auto addPrimitive = [](json& d, const json& p) {
    d["meshes"][0]["primitives"].push_back(p);
  };
  const auto child = [](json& d, const json& node) {
    d["nodes"].push_back(node);
    d["scenes"][0]["nodes"].push_back(d["nodes"].size() - 1);
  };
  const std::vector<Case> cases = {
      {"no positions",
       [&](json& d) {
         addPrimitive(d, {{"attributes", json::object()}});
       },
       "mesh 0 ('m') primitive 1: has no POSITION"},
      {"accessor that lies",
       [&](json& d) {
         d["accessors"].push_back(d["accessors"][0]);
         d["accessors"][1]["count"] = 4000;
         addPrimitive(d, {{"attributes", {{"POSITION", 1}}}});
       },
       "accessor 1"},
      {"accessor of nothing",
       [&](json& d) {
         d["accessors"].push_back({{"componentType", 5126}, {"count", 0}, {"type", "VEC3"}});
         addPrimitive(d, {{"attributes", {{"POSITION", 1}}}});
       },
       "accessor 1"},
      {"no such accessor",
       [&](json& d) {
         addPrimitive(d, {{"attributes", {{"POSITION", 8}}}});
       },
       "accessor 8"},
      {"lines",
       [&](json& d) {
         addPrimitive(d, {{"attributes", {{"POSITION", 0}}}, {"mode", 1}});
       },
       "lines"},
      {"no such mode",
       [&](json& d) {
         addPrimitive(d, {{"attributes", {{"POSITION", 0}}}, {"mode", 9}});
       },
       "mode 9"},
      {"no such mesh",
       [&](json& d) {
         child(d, {{"mesh", 5}});
       },
       "mesh 5"},
      {"no such scene", [](json& d) { d["scene"] = 4; }, "scene 4"},
      {"no such child", [](json& d) { d["nodes"][0]["children"] = {77}; }, "node 77"},
      {"node cycle", [](json& d) { d["nodes"][0]["children"] = {0}; }, "node 0"},
      {"two parents",
       [&](json& d) {
         child(d, {{"children", {0}}});
       },
       "two parents"},
      {"no such material", [](json& d) { d["meshes"][0]["primitives"][0]["material"] = 2; },
       "material 2"},
      {"no such texture",
       [](json& d) {
         addTexture(d, {{"uri", "a.png"}});
         d["materials"][0]["normalTexture"] = {{"index", 6}};
         d["materials"][0].erase("pbrMetallicRoughness");
       },
       "texture 6"},
      {"no such image",
       [](json& d) {
         addTexture(d, {{"uri", "a.png"}});
         d["textures"][0]["source"] = 3;
       },
       "texture 0"},
      {"image outside its buffer",
       [](json& d) {
         d["bufferViews"].push_back({{"buffer", 0}, {"byteLength", 4000}});
         addTexture(d, {{"bufferView", 1}, {"mimeType", "image/png"}});
       },
       "bufferView 1"},
      {"image of no buffer view",
       [](json& d) {
         addTexture(d, {{"bufferView", 9}, {"mimeType", "image/png"}});
       },
       "bufferView 9"},
      {"image of nothing",
       [](json& d) {
         addTexture(d, {{"name", "none"}});
       },
       "bufferView -1"},
      {"buffer longer than the file", [](json& d) { d["buffers"][0]["byteLength"] = 1 << 30; },
       "byteLength is 1073741824"},
      {"buffer file that is not there",
       [&](json& d) {
         d["buffers"].push_back({{"byteLength", 36}, {"uri", "gone.bin"}});
         d["bufferViews"].push_back({{"buffer", 1}, {"byteLength", 36}});
         d["accessors"].push_back(
             {{"bufferView", 1}, {"componentType", 5126}, {"type", "VEC3"}, {"count", 3}});
         addPrimitive(d, {{"attributes", {{"POSITION", 1}}}});
       },
       "gone.bin"},
      {"factor out of range",
       [](json& d) {
         addTexture(d, {{"uri", "a.png"}});
         d["materials"][0]["pbrMetallicRoughness"] = {{"roughnessFactor", 7.5}};
       },
       "roughnessFactor 7.5"},
      {"transform that overflows",
       [&](json& d) {
         child(d, {{"scale", {1e300, 1, 1}}, {"children", {2}}});
         d["nodes"].push_back({{"mesh", 0}, {"scale", {1e300, 1, 1}}});
       },
       "node 2"},
      {"zero rotation",
       [](json& d) {
         d["nodes"][0]["rotation"] = {0, 0, 0, 0};
       },
       "node 0"},
      {"short matrix",
       [](json& d) {
         d["nodes"][0]["matrix"] = {1, 2, 3};
       },
       "matrix"},
      {"matrix that divides",
       [](json& d) {
         d["nodes"][0]["matrix"] = {1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
       },
       "affine"},
      {"no such camera", [](json& d) { d["nodes"][0]["camera"] = 0; }, "camera 0"},
      {"field of view of 0",
       [](json& d) {
         d["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 0}, {"znear", 1}}}}};
         d["nodes"][0]["camera"] = 0;
       },
       "yfov"},
      {"camera of no width",
       [&](json& d) {
         d["cameras"] = {
             {{"type", "orthographic"},
              {"orthographic", {{"xmag", 1.0}, {"ymag", 0.0}, {"zfar", 2.0}, {"znear", 1.0}}}}};
         child(d, {{"camera", 0}});
       },
       "ymag"},
      {"no such light",
       [](json& d) { d["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = 1; }, "light 1"},
      {"no such volume",
       [](json& d) {
         d["nodes"][0]["extras"]["trex_volume"] = {{"file", "none.vdb"}};
       },
       "none.vdb"},
  };
  for (const Case& c : cases) {
    GlbBuilder b = triangleGlb();
    b.json_();
    c.change(b.doc);
    expectReplaced(c.what, "a.glb", b.glb(), c.message, c.triangles);
  }
}

/// What the parser refuses a file for: the part is left out, and the rest is read.
TEST_F(SceneReplaced, GltfPartsOfAnotherForm) {
  struct Case {
    const char* what;
    std::function<void(json&)> change;
    const char* message;
  };
  const json second = {{"attributes", {{"POSITION", 0}}}, {"indices", 77}};
  for (const Case& c : std::vector<Case>{
           {"mesh that is null", [](json& d) { d["meshes"].push_back(nullptr); }, "meshes 1"},
           {"accessor that is text", [](json& d) { d["accessors"].push_back("x"); }, "accessors 1"},
           {"accessor of no type",
            [](json& d) {
              d["accessors"].push_back({{"componentType", 5126}, {"count", 3}, {"type", "VEC9"}});
            },
            "VEC9"},
           {"view that is a number", [](json& d) { d["bufferViews"].push_back(7); },
            "bufferViews 1"},
           {"texture that is text", [](json& d) { d["textures"] = json::array({"x"}); },
            "textures 0"},
           {"sampler that is null", [](json& d) { d["samplers"] = json::array({nullptr}); },
            "samplers 0"},
           {"skin without joints", [](json& d) { d["skins"] = json::array({json::object()}); },
            "skins 0"},
           {"camera of no type", [](json& d) { d["cameras"] = json::array({json::object()}); },
            "cameras 0"},
           {"indices of no accessor",
            [&](json& d) { d["meshes"][0]["primitives"].push_back(second); }, "mesh 0 primitive 1"},
           {"no version", [](json& d) { d["asset"] = json::object(); }, "version"}}) {
    GlbBuilder b = triangleGlb();
    c.change(b.doc);
    GlbBuilder other = b;
    other.json_();
    expectReplaced(c.what, "a.glb", other.glb(), c.message);
  }
}

TEST_F(SceneReplaced, GltfMatrixOfRoundingErrorsIsRight) {
  GlbBuilder b = triangleGlb();
  b.doc["nodes"][0]["matrix"] = {1, 0, 0, 1e-17, 0, 1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1};
  const Scene s = import("a.glb", b.glb());
  EXPECT_EQ(s.replaced.count, 0u);
  EXPECT_EQ(s.instances[0].transform[3][0], 2.0);
  EXPECT_EQ(s.instances[0].transform[0][3], 0.0);
}

TEST_F(SceneReplaced, GltfTrianglesOfBadIndicesAreLeftOut) {
  GlbBuilder b = triangleGlb();
  const int i = b.accessor<std::uint16_t>({0, 1, 3, 2, 1, 0}, 5123, "SCALAR", 6);
  b.doc["meshes"][0]["primitives"][0]["indices"] = i;
  expectReplaced("index", "a.glb", b.glb(), "vertex 3");
}

TEST_F(SceneReplaced, GltfColoursThatAreNotNormalizedCountAsIfTheyWere) {
  GlbBuilder b = triangleGlb();
  const std::vector<std::uint8_t> colors(12, 255);
  b.doc["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] =
      b.accessor(colors, 5121, "VEC4", 3);
  const Scene s = expectReplaced("colour", "a.glb", b.glb(), "COLOR_0");
  EXPECT_EQ(s.meshes[0].colors[0], glm::u8vec4(255));
}

TEST_F(SceneReplaced, ObjFaces) {
  const std::string good = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  struct Case {
    const char *text, *message;
  };
  for (const Case& c : {Case{"f 1 2 9\n", ":5: vertex 9"},
                        {"f -4 -1 -2\n", ":5: vertex -4"},
                        {"f a b c\n", "corner"},
                        {"v 0 x 0\n", ":5: 'x'"},
                        {"v 0 0\n", ":5: a number is missing"},
                        {"l 1 2\np 1\n", "2 lines and points"},
                        {"f 1 2\n", "fewer than 3"},
                        {"mtllib gone.mtl\n", "gone.mtl"},
                        {"v nan 0 0\nf 1 2 4\n", "non-finite"},
                        {"v 1.#QNAN 0 0\nf 1 2 4\n", "non-finite"}}) {
    expectReplaced(c.text, "a.obj", good + c.text, c.message);
  }
  // Without normals or texture coordinates a face is still one.
  expectReplaced("normal", "a.obj", good + "f 1//1 2//1 3//1\n", "normal 1", 2);
  write("a.mtl", "newmtl m\nmap_Kd none.png\nKd red\nNs -5\n");
  const Scene s = expectReplaced("mtl", "a.obj", "mtllib a.mtl\nusemtl m\n" + good, "none.png");
  EXPECT_TRUE(anyReplaced(s, "a.mtl:3: 'red'"));
  EXPECT_TRUE(anyReplaced(s, "a.mtl:4: -5"));
  EXPECT_EQ(s.materials[s.meshes[0].material].baseColor, vec4(0.6f, 0.6f, 0.6f, 1.0f));
}

TEST_F(SceneReplaced, PlyFaces) {
  const auto file = [](const std::string& faces, int count) {
    return "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
           "property float z\nelement face " +
           std::to_string(count) +
           "\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n" + faces;
  };
  expectReplaced("index", "a.ply", file("3 0 1 2\n3 0 1 7\n", 2), "vertex 7");
  expectReplaced("negative", "a.ply", file("3 0 1 -2\n3 0 1 2\n", 2), "vertex -2");
  expectReplaced("small", "a.ply", file("2 0 1\n3 0 1 2\n", 2), "fewer than 3");
}

TEST_F(SceneReplaced, ManyPartsAreCountedAndTheFirstNamed) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  for (int i = 0; i < 1000; ++i) text += "f 1 2 " + std::to_string(10 + i) + "\n";
  const Scene s = import("a.obj", text);
  EXPECT_EQ(s.replaced.count, 1000u);
  EXPECT_EQ(s.replaced.texts.size(), Replaced::kMostTexts);
}

// What the process that reads a file of another format hands over; see src/assimp/child.h.
TEST_F(SceneReplaced, NotesOfAModelThatWasHandedOver) {
  GlbBuilder b = triangleGlb();
  const std::filesystem::path other = write("other.dat", "x");
  b.doc["asset"]["extras"] = {{"replaced", {"a part\nof it", 7, json::array()}},
                              {"warnings", {"a warning"}},
                              {"files", {other.string(), "none", 3}}};
  const std::string glb = b.glb();
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(glb.data()), glb.size());
  const Scene s = detail::readHandedOver(bytes, folder_ / "m.fbx", {});
  EXPECT_EQ(s.replaced.count, 1u);
  EXPECT_TRUE(anyReplaced(s, "m.fbx: a part of it"));
  EXPECT_TRUE(anyWarning(s, "a warning"));
  ASSERT_EQ(s.files.size(), 1u);
  EXPECT_EQ(s.files[0].path, other.string());
  for (const json& wrong : {json(5), json::array({1}), json{{"replaced", "text"}, {"files", 2}}}) {
    b.doc["asset"]["extras"] = wrong;
    const Scene plain = import("m.glb", b.glb());
    EXPECT_EQ(plain.replaced.count, 0u);
  }
  // A file that only says so is not believed.
  b.doc["asset"]["extras"] = {{"replaced", {"a part"}}};
  EXPECT_EQ(import("m.glb", b.glb()).replaced.count, 0u);
}

}  // namespace
}  // namespace trex::test
