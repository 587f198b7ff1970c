// Where rays leave and end: light from near things is right on surfaces of any size, any distance
// from the scene's centre, at any scale, and whatever holds them.
#include <gtest/gtest.h>

#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr float kAlbedo = 0.8f;

dmat4 moved(const dvec3& by, double scale = 1.0) {
  dmat4 m(scale);
  m[3] = glm::dvec4(by, 1.0);
  return m;
}

/// A rectangle at `height` that faces up or down.
Mesh rectangle(float halfX, float halfZ, float height, int material, bool up) {
  Mesh m;
  m.material = material;
  m.positions = {vec3(-halfX, height, halfZ), vec3(halfX, height, halfZ),
                 vec3(halfX, height, -halfZ), vec3(-halfX, height, -halfZ)};
  m.triangles = {{0, 1, 2}, {0, 2, 3}};
  if (!up) m.triangles = {{0, 2, 1}, {0, 3, 2}};
  return m;
}

/// Form factor of a point to a parallel square of 1 m, its centre straight above.
float squareAbove(float height) {
  const float a = 0.5f / height, r = std::sqrt(1.0f + a * a);
  return 4.0f * (a / r * std::atan(a / r)) * kInvPi;
}

/// A lamp of 1 m that shines down from 2 m above a floor, `place` from the scene's centre: a small
/// cube as far on the other side sees to that. The camera looks at the point below the lamp.
Scene lampOverFloor(float halfFloor, double place, double scale = 1.0) {
  Scene scene;
  scene.materials = {test::lambert(kAlbedo), test::lambert(0.0f, 1.0f), test::lambert(0.2f)};
  const dvec3 here(place * scale, 0.0, 0.0);
  test::place(scene, rectangle(halfFloor, halfFloor, 0.0f, 0, true), moved(here, scale));
  test::place(scene, rectangle(0.5f, 0.5f, 2.0f, 1, false), moved(here, scale));
  if (place > 0.0) {
    test::place(scene, test::box(vec3(-0.1f), vec3(0.1f), 0, false),
                moved(-here - dvec3(0.0, scale, 0.0), scale));
  }
  scene.cameras = {
      test::lookAt(here + scale * dvec3(1.5, 3.0, 0.1), here + scale * dvec3(0.0), 2e-3f)};
  return scene;
}

float render(const Scene& scene, std::uint32_t samples = 512,
             const RayScene::Options& options = {}) {
  const RayScene rays(scene, options);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), 1, 1);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
  Moments all;
  for (std::uint32_t s = 0; s < samples; ++s) all.add(tracer.sample({0, 0, s}, 1).common);
  return static_cast<float>(all.mean().x);
}

constexpr double kPlaces[] = {0.0, 1e2, 1e3, 1e4, 1e5};

TEST(RayEnds, LampOverAFloorOfAnySizeAndPlace) {
  const float right = kAlbedo * squareAbove(2.0f);
  EXPECT_NEAR(right, 0.0588f, 1e-4f);
  for (const float half : {1.0f, 48.0f, 49.0f, 1e3f, 1e4f, 5e5f})
    for (const double place : kPlaces)
      EXPECT_NEAR(render(lampOverFloor(half, place)) / right, 1.0f, 0.01f) << half << " " << place;
}

TEST(RayEnds, LampOverAFloorOfAnyScale) {
  const float right = kAlbedo * squareAbove(2.0f);
  for (double scale = 1e-6; scale < 2e7; scale *= 10.0)
    EXPECT_NEAR(render(lampOverFloor(20.0f, 0.0, scale)) / right, 1.0f, 0.01f) << scale;
}

/// Opaque and thin: its shadow is that of the same pane at the centre, and its upper side is lit.
TEST(RayEnds, PaneOfSixMillimetres) {
  for (const bool above : {false, true}) {
    float atCentre = 0.0f;
    for (const float half : {5.0f, 5e5f})
      for (const double place : kPlaces) {
        Scene scene = lampOverFloor(half, place);
        test::place(scene, test::box(vec3(-0.1f, 1.0f, -0.6f), vec3(0.6f, 1.006f, 0.6f), 2, false),
                    moved(dvec3(place, 0.0, 0.0)));
        if (above) {
          scene.cameras = {
              test::lookAt(dvec3(place + 0.9, 1.6, 0.1), dvec3(place, 1.006, 0.0), 2e-3f)};
        } else {
          scene.cameras = {
              test::lookAt(dvec3(place - 1.5, 0.5, 0.1), dvec3(place, 0.0, 0.0), 2e-3f)};
        }
        const float value = render(scene);
        if (atCentre == 0.0f) atCentre = value;
        EXPECT_NEAR(value / atCentre, 1.0f, 0.01f) << half << " " << place << " " << above;
      }
    if (above) {
      EXPECT_NEAR(atCentre, 0.2f * squareAbove(0.994f), 0.002f);
    } else {
      EXPECT_LT(atCentre, 0.6f * kAlbedo * squareAbove(2.0f));
    }
  }
}

/// A marking 1 mm above ground covers it, is lit, and keeps the lamp's light off what is below.
TEST(RayEnds, MarkingAMillimetreAboveGround) {
  for (const float half : {5.0f, 5e5f})
    for (const double place : kPlaces) {
      Scene scene = lampOverFloor(half, place);
      test::place(scene, rectangle(0.1f, 3.0f, 0.001f, 2, true), moved(dvec3(place, 0.0, 0.0)));
      const float seen = render(scene);
      EXPECT_NEAR(seen / (0.2f * squareAbove(1.999f)), 1.0f, 0.01f) << half << " " << place;
      // From between marking and ground.
      scene.cameras = {
          test::lookAt(dvec3(place + 0.02, 0.0005, 0.0), dvec3(place, 0.0, 0.0), 2e-3f)};
      EXPECT_EQ(render(scene, 16), 0.0f) << half << " " << place;
    }
}

/// A ray by the common edge of two huge triangles may be given to the wrong one, but meets it where
/// their plane is: or, by the order of visits, something close above or below would be hidden.
TEST(RayEnds, AHugeFloorIsMetAtItsPlane) {
  Scene scene;
  scene.materials = {test::lambert(kAlbedo)};
  test::place(scene, rectangle(5e5f, 5e5f, 0.0f, 0, true));
  const RayScene rays(scene);
  Sampler sampler(0, 0, 1);
  for (int i = 0; i < 20000; ++i) {
    const vec2 u = sampler.next2D();
    const double along = 100.0 * (static_cast<double>(u.x) - 0.5),
                 off = 0.05 * (static_cast<double>(u.y) - 0.5);
    const dvec3 eye(1.5, 3.0, 0.1), seen(along + off, 0.0, off - along);  // near the diagonal
    const vec3 direction(glm::normalize(seen - eye));
    RayHit hit;
    ASSERT_TRUE(
        rays.intersect(RayStart(eye - rays.renderOrigin()), direction, 0.0f, kInfinity, hit));
    EXPECT_NEAR(static_cast<double>(hit.t) * -static_cast<double>(direction.y) / 3.0, 1.0, 1e-6);
  }
}

/// The same by instances of all sizes, mirrored ones too.
TEST(RayEnds, LampOverAnInstanceOfAFloor) {
  const float right = kAlbedo * squareAbove(2.0f);
  RayScene::Options options;
  options.mergeTriangles = 0;
  for (const double size : {1e-3, 1.0, 1e5})
    for (const double mirror : {1.0, -1.0})
      for (const double place : kPlaces) {
        Scene scene = lampOverFloor(1.0f, place);
        dmat4& floor = scene.instances[0].transform;
        floor[0] *= size * mirror;
        floor[1] *= size;
        floor[2] *= size;
        if (size < 1.0) {  // a floor of a few millimetres: the lamp stays
          scene.cameras = {
              test::lookAt(dvec3(place + 0.015, 0.03, 0.001), dvec3(place, 0.0, 0.0), 2e-3f)};
        }
        scene.instances.push_back(scene.instances[0]);
        scene.instances.back().transform[3] -= glm::dvec4(0.0, 50.0, 0.0, 0.0);
        EXPECT_NEAR(render(scene, 512, options) / right, 1.0f, 0.01f)
            << size << " " << mirror << " " << place;
      }
}

/// Neighbours of a triangle do not shade it: a tilted plane of many triangles in a grazing sun.
TEST(RayEnds, PlaneOfManyTrianglesInAGrazingSun) {
  constexpr std::uint32_t kCells = 48;
  for (const float elevation : {0.3f, 0.01f, 0.001f})
    for (const double place : {0.0, 1e4}) {
      Scene scene;
      scene.materials = {test::lambert(kAlbedo)};
      const Basis basis(glm::normalize(vec3(0.3f, 1.0f, -0.2f)));
      Mesh plane;
      for (std::uint32_t i = 0; i <= kCells; ++i)
        for (std::uint32_t j = 0; j <= kCells; ++j)
          plane.positions.push_back(basis.tangent * (static_cast<float>(i) / kCells - 0.5f) +
                                    basis.bitangent * (static_cast<float>(j) / kCells - 0.5f));
      for (std::uint32_t i = 0; i < kCells; ++i)
        for (std::uint32_t j = 0; j < kCells; ++j) {
          const std::uint32_t a = i * (kCells + 1) + j, b = a + kCells + 1;
          plane.triangles.insert(plane.triangles.end(), {{a, b, b + 1}, {a, b + 1, a + 1}});
        }
      test::place(scene, plane, moved(dvec3(place, 0.0, 0.0)));
      if (place > 0.0) {
        test::place(scene, test::box(vec3(-0.1f), vec3(0.1f), 0, false),
                    moved(dvec3(-place, 0.0, 0.0)));
      }
      Light sun;
      sun.type = Light::Type::kDirectional;
      sun.intensity = vec3(kPi / elevation);
      sun.direction = -glm::normalize(basis.normal * elevation +
                                      basis.tangent * std::sqrt(1.0f - elevation * elevation));
      scene.lights = {sun};
      scene.cameras = {test::lookAt(dvec3(place, 0.0, 0.0) + 3.0 * dvec3(basis.normal),
                                    dvec3(place, 0.0, 0.0), 0.2f)};
      EXPECT_NEAR(render(scene, 1024) / kAlbedo, 1.0f, 0.003f) << elevation << " " << place;
    }
}

}  // namespace
}  // namespace trex
