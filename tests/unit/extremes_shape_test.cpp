// Extremes of geometry: size, slivers, surfaces on and through one another, next to nothing,
// cameras where none should be. docs/tests.md has the numbers.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <glm/gtc/matrix_transform.hpp>
#include <random>

#include "src/core/error.h"
#include "tests/image/reference.h"
#include "tests/image/rendered.h"
#include "tests/unit/scenes.h"

namespace trex::test {
namespace {

double smallestOf(const Rendered& image) {
  double smallest = kInfinity;
  for (const dvec3& m : image.mean) smallest = std::min({smallest, m.x, m.y, m.z});
  return smallest;
}

double deviations(const Rendered& a, const Rendered& b) {
  return (a.total.y - b.total.y) / std::sqrt(a.totalVariance.y + b.totalVariance.y);
}

// --- Size

/// The scene with everything `factor` times as large; its lights are surfaces, so radiance stays.
Scene scaled(Scene scene, double factor) {
  for (Instance& i : scene.instances) {
    i.transform = glm::scale(dmat4(1.0), dvec3(factor)) * i.transform;
  }
  for (Camera& c : scene.cameras) c.eye *= factor;
  return scene;
}

double extentOf(const Scene& scene) {
  const dvec3 size = scene.bounds().size();
  return std::max({size.x, size.y, size.z});
}

/// 1e-6 to 1e7 m; `instances` has meshes that are placed several times.
TEST(Extent, DoesNotChangeThePicture) {
  for (const char* name : {"cornell", "instances"}) {
    const Scene scene = importTestScene(name);
    for (double exact : {1.0, 0.25}) {
      const RenderSettings settings = settingsFor(64, exact, 48);
      const Rendered reference = render(scaled(scene, 1.0 / extentOf(scene)), settings);
      for (double extent : {1e-6, 1e-3, 1e3, 1e7}) {
        const Rendered image = render(scaled(scene, extent / extentOf(scene)), settings);
        const std::string title = fmt::format("extent {} {} m, exact {}", name, extent, exact);
        const double limit = exact < 1.0 ? 0.02 : 0.01;
        report(title + ", FLIP", flip(image, reference), limit);
        EXPECT_LE(flip(image, reference), limit);
        EXPECT_LT(std::abs(deviations(image, reference)), 3.0) << title;
        if (HasFailure()) keepArtefacts(title, image, reference);
      }
    }
  }
}

// --- Needles and triangles without area

/// 10^4 triangles through a room of 2 m: a third are points, a third lines, a third needles of
/// 1e-7 m.
Mesh slivers() {
  Mesh mesh;
  std::mt19937 random(7);
  const auto unit = [&] { return static_cast<float>(random()) * 0x1p-32f; };
  const auto inside = [&] { return 1.8f * vec3(unit(), unit(), unit()) - 0.9f; };
  for (unsigned i = 0; i < 10'000; ++i) {
    const vec3 a = inside(), b = inside();
    const vec3 along = b - a, third = a + unit() * along;
    const vec3 across = 1e-7f * glm::normalize(glm::cross(along, vec3(0.3f, 0.5f, 0.7f)));
    mesh.positions.push_back(a);
    mesh.positions.push_back(i % 3 == 0 ? a : b);
    mesh.positions.push_back(i % 3 == 0 ? a : i % 3 == 1 ? third : b + across);
    mesh.triangles.emplace_back(3 * i, 3 * i + 1, 3 * i + 2);
  }
  return mesh;
}

Scene litBox() {
  Scene scene;
  scene.materials = {lambert(0.6f), lambert(0.4f, 3.0f)};
  place(scene, box(vec3(-1.0f), vec3(1.0f), 0, true));
  place(scene, box(vec3(-0.4f, -0.6f, -0.4f), vec3(0.0f, 0.2f, 0.1f), 0, false));
  place(scene, box(vec3(-0.3f, 0.9f, -0.3f), vec3(0.3f, 0.95f, 0.3f), 1, false));
  scene.cameras = {lookAt(dvec3(0.7, 0.3, 0.8), dvec3(-0.4, -0.3, -0.5), 1.2f)};
  return scene;
}

TEST(Slivers, AreNotSeen) {
  Scene with = litBox();
  place(with, slivers());
  const Rendered clean = render(litBox(), settingsFor(64, 1.0, 64));
  const Rendered image = render(with, settingsFor(64, 1.0, 64, 2));
  const Comparison result = compare(image, clean);
  report("slivers exact, pixels failed", 1.0 - result.pixelsPassed, 0.0025);
  report("slivers exact, deviations of the mean", deviations(image, clean), 3.0);
  EXPECT_GE(result.pixelsPassed, 0.9975);
  EXPECT_LT(std::abs(deviations(image, clean)), 3.0);
  const Rendered guess = render(with, settingsFor(64, 0.0, 32, 2));
  const Rendered cleanGuess = render(litBox(), settingsFor(64, 0.0, 32, 2));
  report("slivers guess, mean ratio - 1", ratio(guess, cleanGuess) - 1.0, 0.02);
  EXPECT_NEAR(ratio(guess, cleanGuess), 1.0, 0.02);
  if (HasFailure()) keepArtefacts("slivers", image, clean);
}

// --- Surfaces in one place, and through one another

/// Two boxes in one place, red and green, and blue ones through them, in a white sky.
Scene tangle() {
  Scene scene;
  scene.materials = {lambert(0.6f), lambert(0.6f), lambert(0.6f)};
  scene.materials[0].baseColor = vec4(0.6f, 0.1f, 0.1f, 1.0f);
  scene.materials[1].baseColor = vec4(0.1f, 0.6f, 0.1f, 1.0f);
  scene.materials[2].baseColor = vec4(0.1f, 0.1f, 0.6f, 1.0f);
  for (int material : {0, 1}) place(scene, box(vec3(-1.0f), vec3(1.0f), material, false));
  const dmat4 turned = glm::rotate(dmat4(1.0), 0.6, glm::normalize(dvec3(1.0, 2.0, 0.5)));
  place(scene, box(vec3(-0.5f, -1.5f, -0.5f), vec3(0.5f, 1.5f, 0.5f), 2, false), turned);
  scene.environment.color = vec3(1.0f);
  scene.cameras = {lookAt(dvec3(2.0, 1.5, 2.5), dvec3(0.0), 0.55f)};
  return scene;
}

TEST(Coincident, SurfacesGiveOneColorOrAMix) {
  for (double exact : {1.0, 0.5}) {
    const Rendered image = render(tangle(), settingsFor(64, exact, 64));
    const Rendered again = render(tangle(), settingsFor(64, exact, 64));
    EXPECT_EQ(image.mean, again.mean);
    report(fmt::format("coincident exact {}, darkest channel", exact), smallestOf(image), 0.015);
    // The least reflectance is 0.1, and corners see some sky.
    EXPECT_GT(smallestOf(image), 0.015);
    for (const dvec3& m : image.mean) EXPECT_LT(std::max({m.x, m.y, m.z}), 1.02);
    if (HasFailure()) keepArtefact("coincident", image);
  }
}

// --- Next to nothing

/// A triangle of albedo 0.5 in a sky of 1 shows 0.5, its surroundings 1.
TEST(OneTriangle, IsRight) {
  Scene scene;
  scene.materials = {lambert(0.5f)};
  Mesh mesh;
  mesh.positions = {vec3(-1.0f, -1.0f, 0.0f), vec3(1.0f, -1.0f, 0.0f), vec3(0.0f, 1.0f, 0.0f)};
  mesh.triangles.emplace_back(0u, 1u, 2u);
  place(scene, mesh);
  scene.environment.color = vec3(1.0f);
  scene.cameras = {lookAt(dvec3(0.0, 0.0, 4.0), dvec3(0.0), 2.0f * std::atan(0.5f))};
  for (double exact : {1.0, 0.0}) {
    const Rendered image = render(scene, settingsFor(32, exact, 64));
    // It covers 2 of 16 m^2 of the picture.
    report(fmt::format("one triangle exact {}, error of the mean", exact),
           image.total.x - (1.0 - 0.5 * 2.0 / 16.0), 0.002);
    EXPECT_NEAR(image.total.x, 1.0 - 0.5 * 2.0 / 16.0, 0.002);
    EXPECT_NEAR(image.mean[16 * 32 + 16].x, 0.5, 0.002);
    EXPECT_EQ(image.mean[0], dvec3(1.0));
  }
}

// --- Cameras where none should be

TEST(CameraInside, ASolidSeesBlack) {
  Scene scene;
  scene.materials = {lambert(0.8f)};
  place(scene, sphere(vec3(0.0f), 1.0f, 0, 24));
  place(scene, box(vec3(2.0f, -1.0f, -1.0f), vec3(4.0f, 1.0f, 1.0f), 0, false));
  scene.environment.color = vec3(1.0f);
  scene.cameras = {lookAt(dvec3(0.1, 0.2, 0.0), dvec3(1.0, 0.0, 0.3), 1.2f)};
  EXPECT_EQ(render(scene, settingsFor(32, 1.0, 64)).total, dvec3(0.0));
  const Rendered guess = render(scene, settingsFor(32, 0.0, 64));
  report("camera in a solid guess, radiance in a sky of 1", guess.total.y, 0.005);
  EXPECT_LT(guess.total.y, 0.005);
}

/// On a face, an edge, a corner and in the middle: finite, and never brighter than the sky.
TEST(CameraOn, ASurfaceIsHarmless) {
  for (const dvec3& eye : {dvec3(1.0, 0.0, 0.0), dvec3(1.0, 1.0, 0.0), dvec3(1.0), dvec3(0.0)}) {
    Scene scene;
    scene.materials = {lambert(0.8f)};
    place(scene, box(vec3(-1.0f), vec3(1.0f), 0, false));
    scene.environment.color = vec3(1.0f);
    scene.cameras = {lookAt(eye, dvec3(0.3, 0.1, 0.2), 1.5f)};
    const Rendered image = render(scene, settingsFor(32, 0.5, 32));
    EXPECT_LE(image.total.y, 1.0);
    EXPECT_GE(image.total.y, 0.0);
  }
}

/// Nothing to see is an error of the input on import (extremes_test.py); a scene made in memory
/// shows its sky.
TEST(NoTriangles, ShowTheSky) {
  Scene scene;
  scene.materials = {lambert(0.5f)};
  scene.environment.color = vec3(0.25f);
  scene.cameras = {lookAt(dvec3(0.0), dvec3(0.0, 0.0, -1.0), 1.0f)};
  for (double exact : {1.0, 0.5}) {
    const Rendered image = render(scene, settingsFor(8, exact, 4));
    EXPECT_NEAR(image.total.x, 0.25, 1e-6);
  }
}

}  // namespace
}  // namespace trex::test
