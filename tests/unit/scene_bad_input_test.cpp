// Every broken file ends in Error(kInput) with one line that names the file and what is wrong.
#include <functional>

#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class SceneBadInput : public SceneTest {
 protected:
  void expectError(const std::string& what, const std::string& file, const std::string& bytes,
                   const std::string& message) {
    const std::filesystem::path path = write(file, bytes);
    try {
      importScene(path);
      ADD_FAILURE() << what << ": was accepted";
    } catch (const Error& e) {
      const std::string text = e.what();
      EXPECT_EQ(e.code(), ExitCode::kInput) << what << ": " << text;
      EXPECT_NE(text.find(file), std::string::npos) << what << ": " << text;
      EXPECT_NE(text.find(message), std::string::npos) << what << ": " << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << what << ": " << text;
    }
  }
};

TEST_F(SceneBadInput, Gltf) {
  struct Case {
    const char* what;
    std::function<void(json&)> change;
    const char* message;
  };
  const std::vector<Case> cases = {
      {"version 1", [](json& d) { d["asset"]["version"] = "1.0"; }, "version 1.0"},
      {"no asset", [](json& d) { d.erase("asset"); }, "asset"},
      {"required extension", [](json& d) { d["extensionsRequired"] = {"EXT_of_another_geometry"}; },
       "EXT_of_another_geometry"},
      {"count beyond the view", [](json& d) { d["accessors"][0]["count"] = 4; }, "accessor 0"},
      {"count of 2^62", [](json& d) { d["accessors"][0]["count"] = 1ull << 62; }, "accessor 0"},
      {"count 0", [](json& d) { d["accessors"][0]["count"] = 0; }, "accessor 0"},
      {"offset wraps around",
       [](json& d) { d["accessors"][0]["byteOffset"] = 0xffffffffffffffffull; }, "accessor 0"},
      {"view beyond the buffer", [](json& d) { d["bufferViews"][0]["byteLength"] = 99999; },
       "bufferView 0"},
      {"view offset wraps around",
       [](json& d) { d["bufferViews"][0]["byteOffset"] = 0xfffffffffffffff0ull; }, "bufferView 0"},
      {"no such view", [](json& d) { d["accessors"][0]["bufferView"] = 7; }, "bufferView 7"},
      {"no such buffer", [](json& d) { d["bufferViews"][0]["buffer"] = 3; }, "buffer 3"},
      {"no such accessor",
       [](json& d) { d["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9; },
       "accessor 9"},
      {"positions of bytes", [](json& d) { d["accessors"][0]["componentType"] = 5130; },
       "accessor 0"},
      {"positions of 2", [](json& d) { d["accessors"][0]["type"] = "VEC2"; }, "POSITION"},
      {"no positions",
       [](json& d) { d["meshes"][0]["primitives"][0]["attributes"] = json::object(); }, "POSITION"},
      {"huge accessor without data",
       [](json& d) {
         d["accessors"][0].erase("bufferView");
         d["accessors"][0]["count"] = 4000000000u;
       },
       "no bufferView"},
      {"sparse index out of range",
       [](json& d) {
         d["accessors"][0]["sparse"] = {
             {"count", 1},
             {"indices", {{"bufferView", 0}, {"byteOffset", 12}, {"componentType", 5125}}},
             {"values", {{"bufferView", 0}}}};
       },
       "sparse index"},
      {"negative sparse count",
       [](json& d) {
         d["accessors"][0]["sparse"] = {{"count", -1},
                                        {"indices", {{"bufferView", 0}, {"componentType", 5125}}},
                                        {"values", {{"bufferView", 0}}}};
       },
       "sparse"},
      {"no such mesh", [](json& d) { d["nodes"][0]["mesh"] = 5; }, "mesh 5"},
      {"transform overflows",
       [](json& d) {
         d["nodes"] = {{{"scale", {1e300, 1, 1}}, {"children", {1}}},
                       {{"mesh", 0}, {"scale", {1e300, 1, 1}}}};
       },
       "node 1"},
      {"nothing to render", [](json& d) { d["nodes"][0].erase("mesh"); }, "no triangle"},
      {"missing buffer file", [](json& d) { d["buffers"][0]["uri"] = "none.bin"; }, "none.bin"},
      {"buffer without data",
       [](json& d) {
         d["bufferViews"][0]["buffer"] = 1;
         d["buffers"].push_back({{"byteLength", 36}});
       },
       "buffer 1 has no data"},
      {"buffers are no list", [](json& d) { d["buffers"] = 5; }, "buffer 0"},
      {"accessors are numbers",
       [](json& d) {
         d["accessors"] = {1, 2};
       },
       "accessors"},
  };
  for (const Case& c : cases) {
    GlbBuilder b = triangleGlb();
    b.json_();
    c.change(b.doc);
    expectError(c.what, "bad.glb", b.glb(), c.message);
  }
}

TEST_F(SceneBadInput, IndicesOutOfRange) {
  GlbBuilder b = triangleGlb();
  const int i = b.accessor<std::uint16_t>({0, 1, 3}, 5123, "SCALAR", 3);
  b.doc["meshes"][0]["primitives"][0]["indices"] = i;
  expectError("index", "bad.glb", b.glb(), "vertex 3");
}

TEST_F(SceneBadInput, GlbContainer) {
  const std::string good = triangleGlb().glb();
  // Cut anywhere, it is an error and not a crash.
  for (std::size_t length = 0; length < good.size(); ++length) {
    expectError("cut", "cut.glb", good.substr(0, length), "");
  }
  std::string bad = good;
  bad[0] = 'x';
  expectError("magic", "bad.glb", bad, "magic");
  bad = good;
  bad[4] = 1;
  expectError("version", "bad.glb", bad, "version 1");
  bad = good;
  bad[15] = '\x7f';
  expectError("chunk length", "bad.glb", bad, "first chunk");
  expectError("deep", "deep.gltf", std::string(100000, '[') + std::string(100000, ']'), "nested");
  expectError("text", "bad.gltf", "{\"asset\": ", "not valid glTF");
  expectError("number", "bad.gltf", "{\"asset\":{\"version\":\"2.0\"},\"scene\":1e999}", "glTF");
}

TEST_F(SceneBadInput, GlbWithFlippedBytesNeverCrashes) {
  const std::string good = triangleGlb().glb();
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const int mask : {0x01, 0x10, 0x80}) {
      std::string bad = good;
      bad[i] = static_cast<char>(bad[i] ^ mask);
      try {
        import("flipped.glb", bad);
      } catch (const Error&) {
      }
    }
  }
}

TEST_F(SceneBadInput, Files) {
  for (const auto& path : {folder_ / "none.glb", folder_, write("empty.obj", ""),
                           write("a.stl", "solid"), folder_ / "none.ply"}) {
    try {
      importScene(path);
      FAIL() << path;
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput) << path;
      EXPECT_NE(std::string(e.what()).find(path.string()), std::string::npos) << e.what();
    }
  }
}

TEST_F(SceneBadInput, Ply) {
  const std::string vertex =
      "element vertex 3\nproperty float x\nproperty float y\n"
      "property float z\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const std::string ascii = "ply\nformat ascii 1.0\n";
  const std::string points = "0 0 0\n1 0 0\n0 1 0\n";
  const std::string binary = "ply\nformat binary_little_endian 1.0\n";
  struct Case {
    const char* what;
    std::string bytes;
    const char* message;
  };
  const std::vector<Case> cases = {
      {"magic", "plx\n", "magic"},
      {"no end", ascii + vertex, "end_header"},
      {"no format", "ply\n" + vertex + "end_header\n", "format"},
      {"unknown format", "ply\nformat middle_endian 1.0\nend_header\n", "format"},
      {"unknown type", ascii + "element vertex 1\nproperty half x\nend_header\n", "half"},
      {"negative count", ascii + "element vertex -1\nend_header\n", "count"},
      {"huge count", binary + "element vertex 99999999999\nproperty float x\nend_header\n",
       "promises"},
      {"huge count of text", ascii + "element vertex 4000000000\nproperty float x\nend_header\n",
       "promises"},
      {"2^64 count", ascii + "element vertex 18446744073709551616\nend_header\n", "count"},
      {"empty rows", ascii + "element junk 9000000000000000000\nend_header\n", "no triangle"},
      {"no z", ascii + "element vertex 0\nproperty float x\nend_header\n", "x, y and z"},
      {"no indices", ascii + "element face 0\nproperty int x\nend_header\n", "vertex_indices"},
      {"float indices",
       ascii + "element face 0\nproperty list uchar float vertex_indices\nend_header\n",
       "integers"},
      {"float count",
       ascii + "element face 0\nproperty list float int vertex_indices\nend_header\n", "integer"},
      {"index out of range", ascii + vertex + face + "end_header\n" + points + "3 0 1 3\n",
       "vertex 3"},
      {"negative index", ascii + vertex + face + "end_header\n" + points + "3 0 1 -1\n", "-1"},
      {"long list", ascii + vertex + face + "end_header\n" + points + "4000000000 0 1 2\n",
       "longer than the file"},
      {"not a number", ascii + vertex + face + "end_header\n0 zero 0\n1 0 0\n0 1 0\n3 0 1 2\n",
       "zero"},
      {"truncated text", ascii + vertex + face + "end_header\n" + points, "element face"},
      {"truncated binary",
       binary + vertex + face + "end_header\n" + std::string(36, '\0') + "\3" +
           std::string(7, '\0'),
       "truncated"},
      {"property first", "ply\nformat ascii 1.0\nproperty float x\nend_header\n", "before element"},
      {"element twice", ascii + vertex + vertex + "end_header\n" + points + points, "twice"},
      {"no faces", ascii + vertex + "end_header\n" + points, "no triangle"},
  };
  for (const Case& c : cases) expectError(c.what, "bad.ply", c.bytes, c.message);
}

TEST_F(SceneBadInput, Obj) {
  struct Case {
    const char *what, *text, *message;
  };
  const std::string points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (const Case& c : {Case{"no faces", "", "no triangle"},
                        {"index beyond", "f 1 2 4\n", ":4: vertex 4"},
                        {"index 0", "f 0 1 2\n", "vertex 0"},
                        {"negative beyond", "f -4 -1 -2\n", "vertex -4"},
                        {"too large", "f 1 2 99999999999999999999\n", "corner"},
                        {"four slashes", "f 1/1/1/1 2 3\n", ":4:"},
                        {"words", "f a b c\n", "corner"},
                        {"bad vertex", "v 0 x 0\n", "'x'"},
                        {"short vertex", "v 0 0\n", "missing"},
                        {"all lost", "v nan 0 0\nf 1 2 4\n", "non-finite"}}) {
    expectError(c.what, "bad.obj", points + c.text, c.message);
  }
}

}  // namespace
}  // namespace trex::test
