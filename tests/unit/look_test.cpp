// Looks: what differs, what that makes invalid, and the overlay on disk.
#include "src/scene/look.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "src/core/error.h"
#include "src/scene/look_file.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

Scene scene() {
  Scene s = test::furnace(0.5f);
  s.source = "model.glb";
  s.materials.push_back(test::lambert(0.2f));
  s.materials[0].name = "wall";
  s.materials[1].name = "floor";
  s.materials[1].attenuationDistance = 2.0f;
  s.objects = {"room", "chair", "table"};
  return s;
}

class LookFileTest : public testing::Test {
 protected:
  LookFileTest() : path_(fs::temp_directory_path() / ("trex-look-" + std::to_string(getpid()))) {}
  ~LookFileTest() override { fs::remove(path_); }
  void write(const std::string& text) { std::ofstream(path_) << text; }
  /// The message of the error that reading ends in.
  std::string errorOf(const std::string& text) {
    write(text);
    const Scene s = scene();
    try {
      readLook(path_, s, lookOf(s));
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::kInput);
      return e.what();
    }
    return "";
  }
  fs::path path_;
};

TEST_F(LookFileTest, ComesBackToTheBit) {
  const Scene s = scene();
  const Look source = lookOf(s);
  Look look = source;
  look.camera.eye = dvec3(1.0 / 3.0, 5e6 + 1e-7, -0.1);
  look.camera.forward = glm::normalize(vec3(0.3f, -0.2f, 0.9f));
  look.camera.up = glm::normalize(glm::cross(look.camera.forward, vec3(0.9f, 0.1f, 0.0f)));
  look.camera.verticalFov = 0.7654321f;
  look.exposure = -1.7f;
  look.materials[0].roughness = 0.1f;
  look.materials[0].emission = vec3(1e-8f, 1e8f, 0.3f);
  look.materials[1].attenuationDistance = kInfinity;
  look.materials[1].alphaMode = AlphaMode::kMask;
  look.lights.emplace_back();
  look.lights[0].name = "lamp \"1\"";
  look.lights[0].radius = 0.25f;
  look.environment.color = vec3(0.1f, 0.2f, 0.3f);
  look.environment.rotation = 1.1f;
  look.hidden = {0, 2};
  look.section = SectionPlane{dvec3(0.1, 0.2, 0.3), vec3(0.0f, 1.0f, 0.0f)};
  const LookLight light{123456, look.camera};
  writeLook(path_, look, s, source, light);
  LookLight read;
  EXPECT_TRUE(readLook(path_, s, source, &read) == look);
  EXPECT_EQ(read.photons, light.photons);
  EXPECT_TRUE(read.aim == light.aim);
  // Nothing is said of what does not differ.
  EXPECT_EQ(lookText(source, s, source).find("materials"), std::string::npos);
}

TEST_F(LookFileTest, FindsThingsByNameWhereNumbersMoved) {
  const Scene s = scene();
  write(R"({"trex": 1, "materials": [{"index": 0, "name": "floor", "metallic": 0.5}],
            "hidden": [{"index": 77, "name": "chair"}]})");
  const Look look = readLook(path_, s, lookOf(s));
  EXPECT_EQ(look.materials[1].metallic, 0.5f);
  EXPECT_EQ(look.hidden, std::vector<std::uint32_t>{1});
}

TEST_F(LookFileTest, BadFilesNameThePlace) {
  EXPECT_NE(errorOf("{").find("not valid JSON"), std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 2})").find("/trex"), std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "colour": 1})").find("/colour"), std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "materials": [{"index": 9}]})").find("/materials/0/index"),
            std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "materials": [{"index": 0, "roughness": 2}]})")
                .find("/materials/0/roughness"),
            std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "materials": [{"index": 0, "roughness": "x"}]})")
                .find("/materials/0/roughness"),
            std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "hidden": [{"index": 0, "name": "sofa"}]})").find("sofa"),
            std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "section": {"point": [0, 0], "normal": [0, 1, 0]}})")
                .find("/section/point"),
            std::string::npos);
  EXPECT_NE(errorOf(R"({"trex": 1, "lights": [{"name": "a"}]})").find("/lights/0/type"),
            std::string::npos);
  EXPECT_NE(errorOf("[]").find("is not an object"), std::string::npos);
}

TEST(Look, ChangesMakeInvalidWhatTheyMust) {
  const Look a = lookOf(scene());
  Look b = a;
  EXPECT_FALSE(compareLooks(a, b).any());
  b.exposure = 1.0f;
  EXPECT_FALSE(invalidatedBy(a, b).frame);
  b.camera.eye.x += 1.0;
  Invalidation v = invalidatedBy(a, b);
  EXPECT_TRUE(v.frame);
  EXPECT_FALSE(v.flux || v.lights || v.voxelShape) << "camera moves keep photons";
  b = a;
  b.materials[1].roughness = 0.5f;
  v = invalidatedBy(a, b);
  EXPECT_TRUE(v.frame && v.flux && v.voxelValues);
  EXPECT_FALSE(v.lights || v.voxelShape);
  b.materials[1].transmission = 1.0f;
  b.materials[1].roughness = 0.0f;
  EXPECT_TRUE(invalidatedBy(a, b).voxelShape) << "clear glass has no voxels";
  b = a;
  b.materials[1].emission = vec3(1.0f);
  EXPECT_TRUE(invalidatedBy(a, b).lights);
  b = a;
  b.lights.emplace_back();
  v = invalidatedBy(a, b);
  EXPECT_TRUE(v.lights && v.flux && v.frame);
  EXPECT_FALSE(v.voxelValues);
  b = a;
  b.hidden = {1};
  v = invalidatedBy(a, b);
  EXPECT_TRUE(v.voxelShape && v.lights && v.flux);
}

}  // namespace
}  // namespace trex
