// CameraControl: what each move keeps and where it ends.
#include "src/viewer/camera_control.h"

#include <gtest/gtest.h>

#include <cmath>

#include "src/scene/import.h"

namespace trex {
namespace {

const Box3d kBox{dvec3(-1.0), dvec3(1.0)};

Camera front() {
  Camera camera;
  camera.eye = dvec3(0.0, 0.0, 5.0);
  return camera;
}

void expectNear(const dvec3& a, const dvec3& b, double tolerance = 1e-6) {
  EXPECT_LT(glm::length(a - b), tolerance)
      << a.x << ' ' << a.y << ' ' << a.z << " against " << b.x << ' ' << b.y << ' ' << b.z;
}

void expectOrthonormal(const Camera& camera) {
  EXPECT_NEAR(glm::length(camera.forward), 1.0f, 1e-5f);
  EXPECT_NEAR(glm::length(camera.up), 1.0f, 1e-5f);
  EXPECT_NEAR(glm::dot(camera.forward, camera.up), 0.0f, 1e-5f);
}

TEST(CameraControl, PivotLiesOnTheAxisNearestTheCentre) {
  expectNear(CameraControl(front(), kBox).pivot(), dvec3(0.0));
  Camera beside = front();
  beside.eye.x = 0.5;
  expectNear(CameraControl(beside, kBox).pivot(), dvec3(0.5, 0.0, 0.0));
}

TEST(CameraControl, PivotOfACameraThatLooksAwayIsInFrontOfIt) {
  Camera away = front();
  away.forward = vec3(0.0f, 0.0f, 1.0f);
  const CameraControl control(away, kBox);
  EXPECT_GT(control.pivot().z, away.eye.z);
}

TEST(CameraControl, OrbitKeepsTheDistanceAndTheHorizon) {
  CameraControl control(front(), kBox);
  for (int i = 0; i < 100; ++i) {
    control.orbit(vec2(0.037f, 0.011f * std::sin(static_cast<float>(i))));
    EXPECT_NEAR(glm::length(control.camera().eye), 5.0, 1e-4);
    const vec3 right = glm::cross(control.camera().forward, control.camera().up);
    EXPECT_NEAR(right.y, 0.0f, 1e-5f);
    expectNear(control.pivot(), dvec3(0.0));
    expectOrthonormal(control.camera());
  }
}

TEST(CameraControl, OrbitByAHeightIsHalfATurn) {
  CameraControl control(front(), kBox);
  control.orbit(vec2(1.0f, 0.0f));
  expectNear(control.camera().eye, dvec3(0.0, 0.0, -5.0), 1e-5);
}

TEST(CameraControl, OrbitStopsShortOfThePoles) {
  for (const float drag : {10.0f, -10.0f}) {
    CameraControl control(front(), kBox);
    control.orbit(vec2(0.0f, drag));
    expectOrthonormal(control.camera());
    EXPECT_GT(control.camera().up.y, 0.0f);
    EXPECT_NEAR(std::abs(control.camera().eye.y), 5.0, 0.01);
    control.orbit(vec2(0.0f, -0.5f * drag));
    EXPECT_TRUE(std::isfinite(control.camera().eye.x));
  }
}

TEST(CameraControl, ACameraThatStartsAtAPoleCanTurnBack) {
  Camera above;
  above.eye = dvec3(0.0, 5.0, 0.0);
  above.forward = vec3(0.0f, -1.0f, 0.0f);
  above.up = vec3(0.0f, 0.0f, -1.0f);
  CameraControl control(above, kBox);
  control.orbit(vec2(0.1f, -0.25f));
  expectOrthonormal(control.camera());
  EXPECT_NEAR(glm::length(control.camera().eye), 5.0, 1e-4);
  EXPECT_LT(control.camera().eye.y, 4.9);
}

TEST(CameraControl, ZUpCamerasTurnAboutZ) {
  Camera camera;
  camera.eye = dvec3(0.0, -5.0, 0.0);
  camera.forward = vec3(0.0f, 1.0f, 0.0f);
  camera.up = vec3(0.0f, 0.0f, 1.0f);
  CameraControl control(camera, kBox);
  control.orbit(vec2(0.3f, 0.1f));
  EXPECT_NEAR(glm::cross(control.camera().forward, control.camera().up).z, 0.0f, 1e-5f);
}

TEST(CameraControl, LookTurnsAtTheEye) {
  CameraControl control(front(), kBox);
  control.look(vec2(0.5f, 0.2f));
  expectNear(control.camera().eye, front().eye);
  EXPECT_NEAR(glm::length(control.pivot() - front().eye), 5.0, 1e-5);
  EXPECT_LT(control.camera().forward.x, control.camera().forward.z * -1.0f);
  expectOrthonormal(control.camera());
}

TEST(CameraControl, PanMovesThePivotWithThePointer) {
  CameraControl control(front(), kBox);
  control.pan(vec2(0.1f, 0.0f));
  const double height = 2.0 * 5.0 * std::tan(0.5 * double(front().verticalFov));
  expectNear(control.camera().eye, dvec3(-0.1 * height, 0.0, 5.0), 1e-5);
  expectNear(control.pivot(), dvec3(-0.1 * height, 0.0, 0.0), 1e-5);
}

TEST(CameraControl, DollyNeverGoesThroughThePivot) {
  CameraControl control(front(), kBox);
  for (int i = 0; i < 500; ++i) control.dolly(1.0f);
  EXPECT_GT(control.camera().eye.z, 0.0);
  EXPECT_LT(control.camera().eye.z, 1e-3);
  for (int i = 0; i < 100; ++i) control.dolly(-1.0f);
  EXPECT_GT(control.camera().eye.z, 5.0);
  control.setPivot(control.camera().eye);
  control.dolly(3.0f);
  EXPECT_TRUE(std::isfinite(control.camera().eye.z));
}

TEST(CameraControl, DollyThereAndBack) {
  CameraControl control(front(), kBox);
  control.dolly(3.5f);
  control.dolly(-3.5f);
  expectNear(control.camera().eye, front().eye, 1e-9);
}

TEST(CameraControl, DollyMagnifiesAnOrthographicView) {
  Camera camera = front();
  camera.orthographic = true;
  CameraControl control(camera, kBox);
  control.dolly(1.0f);
  expectNear(control.camera().eye, camera.eye);
  EXPECT_LT(control.camera().orthographicHeight, camera.orthographicHeight);
}

TEST(CameraControl, FlyFollowsTimeAndTheScenesSize) {
  CameraControl one(front(), kBox), two(front(), kBox);
  one.fly(vec3(0.0f, 0.0f, 1.0f), 1.0, 1.0);
  for (int i = 0; i < 10; ++i) two.fly(vec3(0.0f, 0.0f, 1.0f), 0.1, 1.0);
  expectNear(one.camera().eye, two.camera().eye, 1e-9);
  EXPECT_NEAR(5.0 - one.camera().eye.z, 0.25 * one.sceneSize(), 1e-9);
  CameraControl large(front(), Box3d{dvec3(-1000.0), dvec3(1000.0)});
  large.fly(vec3(0.0f, 0.0f, 1.0f), 1.0, 1.0);
  EXPECT_NEAR(5.0 - large.camera().eye.z, 1000.0 * (5.0 - one.camera().eye.z), 1e-3);
}

TEST(CameraControl, FrameSeesTheWholeBox) {
  for (const double aspect : {0.3, 1.0, 3.0}) {
    CameraControl control(front(), kBox);
    control.orbit(vec2(0.2f, 0.1f));
    control.frame(kBox, aspect);
    const Camera& c = control.camera();
    const vec3 right = glm::cross(c.forward, c.up);
    const double tall = std::tan(0.5 * double(c.verticalFov));
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      const dvec3 v = p - c.eye;
      const double depth = glm::dot(v, dvec3(c.forward));
      EXPECT_GT(depth, 0.0);
      EXPECT_LE(std::abs(glm::dot(v, dvec3(c.up))), tall * depth);
      EXPECT_LE(std::abs(glm::dot(v, dvec3(right))), tall * aspect * depth);
    }
  }
}

TEST(CameraControl, WorksFarFromTheOrigin) {
  const dvec3 far(5e6, -3e6, 2e6);
  Camera camera = front();
  camera.eye += far;
  CameraControl control(camera, Box3d{far - 1.0, far + 1.0});
  control.orbit(vec2(0.3f, -0.1f));
  EXPECT_NEAR(glm::length(control.camera().eye - far), 5.0, 1e-5);
}

TEST(CameraControl, AnEmptySceneIsNoTrouble) {
  CameraControl control(front(), Box3d{});
  control.frame(Box3d{}, 1.0);
  control.dolly(2.0f);
  control.fly(vec3(1.0f), 1.0, kFastPace);
  EXPECT_TRUE(std::isfinite(glm::length(control.camera().eye)));
}

TEST(CameraText, IsReadBack) {
  CameraControl control(front(), kBox);
  control.orbit(vec2(0.123f, 0.077f));
  control.dolly(1.7f);
  const Camera read = parseCamera(cameraText(control.camera()), Scene{});
  expectNear(read.eye, control.camera().eye, 1e-12);
  expectNear(dvec3(read.forward), dvec3(control.camera().forward));
  expectNear(dvec3(read.up), dvec3(control.camera().up));
  EXPECT_NEAR(read.verticalFov, control.camera().verticalFov, 1e-6f);
}

}  // namespace
}  // namespace trex
