// Replay scripts: what is read, what is refused, what a step does to a look.
#include "src/viewer/replay.h"

#include <gtest/gtest.h>

#include "src/core/error.h"

namespace trex {
namespace {

ReplayScript parsed(const std::string& steps) {
  return parseReplay(R"({"trex": 1, "steps": [)" + steps + "]}", "script.json");
}

std::string refusal(const std::string& text) {
  try {
    parseReplay(text, "script.json");
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kInput);
    return e.what();
  }
  return "accepted";
}

struct Applied {
  Scene scene;
  Look look;
  Applied() {
    scene.materials.resize(2);
    scene.materials[0].name = "wall";
    scene.materials[1].name = "floor";
    scene.objects = {"room", "lamp", "chair"};
    scene.cameras.resize(1);
    scene.cameras[0].name = "front";
    scene.cameras[0].eye = dvec3(0.0, 0.0, 5.0);
    look = lookOf(scene);
  }
  void apply(const std::string& step) {
    const Look source = lookOf(scene);
    CameraControl camera(look.camera, bounds());
    const ReplayScene where{scene, source, bounds(), 1.0};
    for (const ReplayStep& each : parsed(step).steps) applyReplay(each, where, camera, look);
  }
  static Box3d bounds() { return {dvec3(-1.0), dvec3(1.0)}; }
};

TEST(Replay, ReadsTheWholeForm) {
  const ReplayScript script = parseReplay(
      R"({"trex": 1, "size": "320x200", "ui": true, "steps": [
          {"wait": "ready", "label": "start"},
          {"camera": {"orbit": [0.1, 0]}, "settle": 2.5, "frames": 3},
          {"material": {"index": 0, "roughness": 0.2}, "repeat": 4, "screenshot": "a.png"},
          {"undo": true, "redo": 2, "view": {"mode": "normal", "split_at": 0.25}},
          {"close": true}]})",
      "script.json");
  EXPECT_EQ(script.width, 320u);
  EXPECT_EQ(script.height, 200u);
  EXPECT_TRUE(script.ui);
  ASSERT_EQ(script.steps.size(), 5u);
  EXPECT_EQ(script.steps[0].wait, ReplayWait::kReady);
  EXPECT_EQ(script.steps[0].label, "start");
  EXPECT_EQ(script.steps[1].label, "camera");
  EXPECT_EQ(script.steps[1].settle, 2.5);
  EXPECT_TRUE(script.steps[1].edits());
  EXPECT_EQ(script.steps[2].repeat, 4u);
  EXPECT_EQ(script.steps[2].screenshot, "a.png");
  EXPECT_EQ(script.steps[3].undo, 1);
  EXPECT_EQ(script.steps[3].redo, 2);
  EXPECT_EQ(script.steps[3].mode, ViewMode::kNormal);
  EXPECT_EQ(script.steps[3].splitAt, 0.25f);
  EXPECT_TRUE(script.steps[4].close);
}

TEST(Replay, RefusalsNameThePlace) {
  EXPECT_NE(refusal("{").find("script.json: not valid JSON"), std::string::npos);
  EXPECT_NE(refusal(R"({"steps": []})").find("trex"), std::string::npos);
  EXPECT_NE(refusal(R"({"trex": 2, "steps": []})").find("version 1"), std::string::npos);
  EXPECT_NE(refusal(R"({"trex": 1, "steps": [{}, {"materail": {}}]})").find("/steps/1"),
            std::string::npos);
  for (const char* step :
       {R"({"size": "10"})", R"({"size": "0x5"})", R"({"size": "5x5x5"})", R"({"settle": -1})",
        R"({"wait": "later"})", R"({"pick": [1]})", R"({"repeat": 0})", R"({"camera": 3})",
        R"({"view": {"mode": "smell"}})", R"({"view": {"colour": 1}})", R"({"material": 3})"}) {
    EXPECT_NE(refusal(R"({"trex": 1, "steps": [)" + std::string(step) + "]}"), "accepted") << step;
  }
}

TEST(Replay, MaterialsByNameAndNumber) {
  Applied a;
  a.apply(R"({"material": {"name": "floor", "roughness": 0.25, "base_color": [1, 0, 0, 1]}})");
  EXPECT_EQ(a.look.materials[1].roughness, 0.25f);
  EXPECT_EQ(a.look.materials[1].baseColor, vec4(1.0f, 0.0f, 0.0f, 1.0f));
  EXPECT_EQ(a.look.materials[1].metallic, a.scene.materials[1].metallic);
  a.apply(R"({"material": {"index": 0, "unlit": true}})");
  EXPECT_TRUE(a.look.materials[0].unlit);
  a.apply(R"({"revert": true})");
  EXPECT_TRUE(a.look.materials == a.scene.materials);
}

TEST(Replay, LightsAreAddedChangedAndRemoved) {
  Applied a;
  a.apply(R"({"light": {"add": true, "name": "lamp", "position": [1, 2, 3]}})");
  ASSERT_EQ(a.look.lights.size(), 1u);
  EXPECT_EQ(a.look.lights[0].position, dvec3(1.0, 2.0, 3.0));
  a.apply(R"({"light": {"name": "lamp", "intensity": [5, 5, 5], "radius_metres": 0.25}})");
  EXPECT_EQ(a.look.lights[0].intensity, vec3(5.0f));
  EXPECT_EQ(a.look.lights[0].radius, 0.25f);
  EXPECT_EQ(a.look.lights[0].position, dvec3(1.0, 2.0, 3.0));
  a.apply(R"({"light": {"index": 0, "remove": true}})");
  EXPECT_TRUE(a.look.lights.empty());
}

TEST(Replay, EnvironmentSectionAndVisibility) {
  Applied a;
  a.apply(R"({"environment": {"color": [1, 2, 3], "rotation_radians": 0.5}})");
  EXPECT_EQ(a.look.environment.color, vec3(1.0f, 2.0f, 3.0f));
  EXPECT_EQ(a.look.environment.rotation, 0.5f);
  a.apply(R"({"section": {"point": [0, 1, 0], "normal": [0, 1, 0]}})");
  ASSERT_TRUE(a.look.section);
  a.apply(R"({"section": null})");
  EXPECT_FALSE(a.look.section);
  a.apply(R"({"hide": ["chair", 0]})");
  EXPECT_EQ(a.look.hidden, (std::vector<std::uint32_t>{0, 2}));
  a.apply(R"({"show": [0]})");
  EXPECT_EQ(a.look.hidden, (std::vector<std::uint32_t>{2}));
  a.apply(R"({"isolate": "lamp"})");
  EXPECT_EQ(a.look.hidden, (std::vector<std::uint32_t>{0, 2}));
  a.apply(R"({"show_all": true})");
  EXPECT_TRUE(a.look.hidden.empty());
}

TEST(Replay, Cameras) {
  Applied a;
  a.apply(R"({"camera": "0,1,5/0,1,0/0,1,0/40"})");
  EXPECT_EQ(a.look.camera.eye, dvec3(0.0, 1.0, 5.0));
  a.apply(R"({"camera": "front"})");
  EXPECT_EQ(a.look.camera.eye, dvec3(0.0, 0.0, 5.0));
  a.apply(R"({"camera": {"orbit": [1, 0]}})");
  EXPECT_NEAR(a.look.camera.eye.z, -5.0, 1e-5);
  a.apply(R"({"camera": {"frame": true}, "exposure": 1.5})");
  EXPECT_EQ(a.look.exposure, 1.5f);
}

TEST(Replay, WhatDoesNotExistIsAnError) {
  for (const char* step :
       {R"({"material": {"name": "gold"}})", R"({"material": {"index": 2}})",
        R"({"material": {"roughness": 1}})", R"({"material": {"index": 0, "shine": 1}})",
        R"({"material": {"index": 0, "roughness": 2}})", R"({"light": {"index": 0}})",
        R"({"light": {"add": true, "colour": [1, 1, 1]}})", R"({"hide": ["sofa"]})",
        R"({"hide": [3]})", R"({"camera": "back"})", R"({"camera": {"jump": 1}})",
        R"({"section": {"point": [0, 0, 0], "normal": [0, 5, 0]}})",
        R"({"environment": {"color": [-1, 0, 0]}})"}) {
    Applied a;
    EXPECT_THROW(a.apply(step), Error) << step;
  }
}

}  // namespace
}  // namespace trex
