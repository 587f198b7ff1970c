// What fuzzing found, each as the smallest input that showed it.
#include "src/scene/import_detail.h"
#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

class FuzzRegressions : public SceneTest {
 protected:
  /// The message of the Error(kInput) that importing the model ends in.
  std::string refusal(GlbBuilder model) {
    try {
      import("m.glb", model.glb());
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kInput);
      return error.what();
    }
    ADD_FAILURE() << "was accepted";
    return "";
  }
};

// The face's normal overflows to (1e20, NaN, -1e20), which replaced a normal that was no use.
TEST_F(FuzzRegressions, NormalsOfHugeFacesAreFinite) {
  Scene scene;
  Mesh mesh;
  mesh.positions.assign(3, vec3(0.0f));
  mesh.positions[1] = vec3(1e20f, 1.0f, 1e20f);
  mesh.positions[2] = vec3(1e20f, 0.0f, 1e20f);
  mesh.triangles.emplace_back(0, 1, 2);
  mesh.normals.assign(3, vec3(0.0f));
  detail::sanitiseMesh(scene, mesh, "mesh");
  for (const vec3& n : mesh.normals) EXPECT_NEAR(glm::length(n), 1.0f, 1e-6f);
}

// The eye, a few metres from a centre at 1e17 m, rounded to the centre: no direction was left.
TEST_F(FuzzRegressions, CameraFramesAModelFarAway) {
  GlbBuilder model = triangleGlb();
  model.doc["nodes"][0]["translation"] = {0, 0, 1e17};
  const Camera camera = import("m.glb", model.glb()).cameras.at(0);
  EXPECT_NEAR(glm::length(camera.forward), 1.0f, 1e-6f);
  EXPECT_NEAR(glm::length(camera.up), 1.0f, 1e-6f);
  EXPECT_LT(camera.forward.z, -0.9f);
}

TEST_F(FuzzRegressions, NothingIsBeyondTheRangeOfSinglePrecision) {
  for (const double far : {1e19, -1e30, 1e308}) {
    GlbBuilder model = triangleGlb();
    model.doc["nodes"][0]["translation"] = {0, 0, far};
    EXPECT_NE(refusal(model).find("beyond 1e+18 m"), std::string::npos) << far;
    model = triangleGlb();
    model.doc["cameras"] = {
        {{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 1}}}}};
    model.node({{"camera", 0}, {"translation", {far, 0, 0}}});
    EXPECT_NE(refusal(model).find("camera"), std::string::npos) << far;
  }
}

// Up to 8 bytes behind the file were read as data of the buffer.
TEST_F(FuzzRegressions, SecondChunkLiesInsideTheFile) {
  for (const std::size_t missing : {1, 7, 8}) {
    GlbBuilder model = triangleGlb();
    std::string bytes = model.glb();
    bytes.resize(bytes.size() - missing);
    const auto length = static_cast<std::uint32_t>(bytes.size());
    std::memcpy(bytes.data() + 8, &length, sizeof(length));
    try {
      import("m.glb", bytes);
      ADD_FAILURE() << "was accepted without its last " << missing << " bytes";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::kInput);
      EXPECT_NE(std::string(error.what()).find("second chunk"), std::string::npos);
    }
  }
}

// Numbers that no int holds were converted to one.
TEST_F(FuzzRegressions, IndicesInExtensionsAreChecked) {
  for (const double index : {1e39, -1.0, 0.5}) {
    GlbBuilder model = triangleGlb();
    model.doc["extensionsUsed"] = {"KHR_lights_punctual"};
    model.doc["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
    model.doc["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = index;
    EXPECT_TRUE(anyReplaced(import("m.glb", model.glb()), "light -1 does not exist")) << index;

    model = triangleGlb();
    model.doc["meshes"][0]["primitives"][0]["material"] = 0;
    model.doc["materials"] = {
        {{"extensions", {{"KHR_materials_specular", {{"specularTexture", {{"index", index}}}}}}}}};
    EXPECT_TRUE(anyReplaced(import("m.glb", model.glb()), "specularTexture has no index")) << index;
  }
}

// Where "\r" ends lines, "\n" stayed in names and messages.
TEST_F(FuzzRegressions, MessagesAreOfOneLine) {
  const auto one = [&](const std::string& name, const std::string& bytes) {
    try {
      for (const std::string& text : import(name, bytes).replaced.texts) {
        EXPECT_EQ(text.find('\n'), std::string::npos) << text;
      }
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    }
  };
  one("a.ply", "ply\rN\nD binary\nttle_end");
  one("a.obj", "mtllib none\rv 0 0\n0\nv 1 0 0\rv 1 1 0\rusemtl a\nb\rf 1 2 3\r");
  one("a.pbrt", "Film \"image\" \"f\\ng t\" \"integer\"\n");
  one("b.pbrt", "\"Fi\\nlm\"\n");
  one("c.pbrt", "Camera \"a\" \"float fov\" \"f\\ng t\"\nMaterial \"x\\ny\"\nShape \"u\\nv\"\n");
  one("b.obj", "mtllib a\nb\rusemtl c\nd\rv 0 0\r");
}

}  // namespace
}  // namespace trex::test
