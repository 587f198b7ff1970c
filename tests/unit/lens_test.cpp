// Depth of field against the formula of the thin lens, and where the environment lies.
#include <gtest/gtest.h>

#include "src/paths/path_tracer.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 48;

struct Dot {
  double energy = 0.0;     ///< sum over the picture
  double radius = 0.0;     ///< of a disk with the same second moment, pixels
  double furthest = 0.0;   ///< centre of the furthest lit pixel from the picture's, pixels
  double footprint = 0.0;  ///< mean of the lit samples, metres
};

/// A bright square on the axis at `depth` metres, two pixels wide, seen through `camera`.
Dot seeDot(const Camera& camera, float depth, std::uint32_t samples) {
  const float half = depth * 2.0f * std::tan(0.5f * camera.verticalFov) / kSide;
  Scene scene;
  scene.materials = {test::lambert(0.0f, 1.0f)};
  test::place(scene,
              test::box(vec3(-half, -half, -depth - 0.01f), vec3(half, half, -depth), 0, false));
  scene.cameras = {camera};
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays view(camera, rays.renderOrigin(), kSide, kSide);
  const PathTracer tracer(scene, rays, lights, view, GuessOptions{}, 0);
  Dot dot;
  double moment = 0.0, lit = 0.0;
  for (std::uint32_t i = 0; i < kSide * kSide * samples; ++i) {
    const std::uint32_t s = i % samples, x = i / samples % kSide, y = i / samples / kSide;
    const PathSample p = tracer.sample({x, y, s}, kSide);
    if (p.common.x <= 0.0f) continue;
    const double dx = x + 0.5 - kSide / 2.0, dy = y + 0.5 - kSide / 2.0;
    dot.energy += double{p.common.x} / samples;
    moment += (dx * dx + dy * dy) * p.common.x / samples;
    dot.furthest = std::max(dot.furthest, std::hypot(dx, dy));
    dot.footprint += p.feature.footprint;
    lit += 1.0;
  }
  dot.footprint /= lit;
  // The square widens it by its own second moment: 2^2 / 12 an axis.
  dot.radius = std::sqrt(std::max(0.0, 2.0 * (moment / dot.energy - 2.0 / 3.0)));
  return dot;
}

TEST(Lens, BlurIsThatOfTheFormulaAndKeepsTheLight) {
  Camera pinhole;
  pinhole.verticalFov = 0.3f;
  const double focal = 0.012 / std::tan(0.15);
  for (const float depth : {1.0f, 2.0f, 8.0f}) {
    const Dot sharp = seeDot(pinhole, depth, 256);
    EXPECT_LT(sharp.radius, 0.5);
    Camera camera = pinhole;
    camera.focus = 2.0f;
    camera.fstop = 0.5f;
    const Dot dot = seeDot(camera, depth, 256);
    // The diameter's angle, aperture * |1 / depth - 1 / focus|, in pixels.
    const double aperture = focal / 0.5;
    const double radius =
        0.5 * aperture * std::abs(1.0 / depth - 0.5) * kSide / (2.0 * std::tan(0.15));
    EXPECT_NEAR(dot.radius, radius, std::max(0.02 * radius, 0.5)) << depth;
    EXPECT_LT(dot.furthest, radius + 2.5) << depth;
    EXPECT_NEAR(dot.energy / sharp.energy, 1.0, 0.04) << depth;
    // A pixel mixes as much of the object's plane as the blur is wide there.
    const double pixel = 2.0 * std::tan(0.15) / kSide * depth;
    EXPECT_NEAR(dot.footprint, pixel * (1.0 + 2.0 * radius), 0.03 * dot.footprint) << depth;
  }
}

/// Half the aperture, half the blur; at the focus none at all.
TEST(Lens, FollowsTheFNumber) {
  Camera camera;
  camera.verticalFov = 0.3f;
  camera.focus = 4.0f;
  camera.fstop = 0.4f;
  const double wide = seeDot(camera, 1.0f, 256).radius;
  camera.fstop = 0.8f;
  EXPECT_NEAR(seeDot(camera, 1.0f, 256).radius / wide, 0.5, 0.02);
}

/// Whatever place of the lens it passes, a ray meets the plane of focus where the pinhole's does.
TEST(Lens, RaysOfAPixelMeetInThePlaneOfFocus) {
  Camera camera = test::lookAt(dvec3(3.0, 2.0, 1.0), dvec3(-1.0, 0.0, 0.5), 0.8f);
  camera.focus = 5.0f;
  camera.fstop = 0.5f;
  const CameraRays view(camera, dvec3(0.0), kSide, kSide);
  for (std::uint32_t i = 0; i < 64; ++i) {
    Sampler sampler(i, 0, 0);
    const vec2 at = sampler.next2D() * static_cast<float>(kSide);
    dvec3 eye;
    vec3 straight;
    view.ray(at.x, at.y, eye, straight);
    auto origin = eye;
    auto direction = straight;
    view.throughLens(sampler.next2D(), origin, direction);
    const vec3 moved(origin - eye);
    EXPECT_NEAR(glm::dot(moved, camera.forward), 0.0f, 1e-6f);
    EXPECT_LT(glm::length(moved), camera.lensRadius() * 1.0001f);
    const vec3 sharp = straight * (5.0f / glm::dot(straight, camera.forward));
    const vec3 met = moved + direction * (5.0f / glm::dot(direction, camera.forward));
    EXPECT_LT(glm::length(sharp - met), 1e-5f);
  }
}

/// What --env says of maps: the centre at -z, its right half towards +x, the top at +y; rotation
/// counter-clockwise as seen from above, and the strength.
TEST(Environment, TheCentreOfAMapLiesAtMinusZ) {
  constexpr int kWidth = 8, kHeight = 4;
  auto map = std::make_shared<Image>();
  map->width = kWidth;
  map->height = kHeight;
  map->channels = 3;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {  // red grows to the right, green downwards
      map->floats.insert(map->floats.end(), {static_cast<float>(x), static_cast<float>(y), 1.0f});
    }
  }
  Scene scene = test::furnace(0.5f);
  scene.environment.map = map;
  const RayScene rays(scene);
  const auto along = [&](const vec3& direction) {
    return LightSet(scene, rays).environment(direction);
  };
  scene.environment.color = vec3(1.0f);
  EXPECT_NEAR(along(vec3(0, 0, -1)).x, 3.5f, 1e-4f);  // between the two texels of the middle
  EXPECT_NEAR(along(vec3(1, 0, 0)).x, 5.5f, 1e-4f);
  EXPECT_NEAR(along(vec3(-1, 0, 0)).x, 1.5f, 1e-4f);
  EXPECT_NEAR(along(vec3(0, 1, 0)).y, 0.0f, 1e-4f);
  EXPECT_NEAR(along(vec3(0, -1, 0)).y, 3.0f, 1e-4f);
  scene.environment.rotation = kPi / 2.0f;  // the centre goes from -z to -x
  scene.environment.color = vec3(2.0f);
  EXPECT_NEAR(along(vec3(-1, 0, 0)).x, 2.0f * 3.5f, 1e-3f);
  EXPECT_NEAR(along(vec3(0, 0, -1)).x, 2.0f * 5.5f, 1e-3f);
}

}  // namespace
}  // namespace trex
