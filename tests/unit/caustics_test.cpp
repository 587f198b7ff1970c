#include "src/paths/caustics.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "src/paths/photons.h"
#include "src/paths/walk_tracer.h"
#include "tests/unit/glass_scenes.h"

namespace trex {
namespace {

constexpr float kAlbedo = 1e-3f;  // of floors: little returns to them

constexpr std::uint32_t kSide = 32;

/// Exact irradiance of the floor in a picture of kSide x kSide pixels.
std::vector<vec3> picture(const Scene& scene, std::uint32_t samples, std::uint32_t seed = 0) {
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const WalkTracer walks(rays);
  CausticMaps maps(scene, walks, kSide * kSide, seed);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, seed, true, &maps);
  std::vector<Moments> all(kSide * kSide);
  for (std::uint32_t s = 0; s < samples; ++s) {
    maps.prepare({&s, 1});
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      all[i].add(tracer.sample({i % kSide, i / kSide, s}, kSide).common);
    }
  }
  std::vector<vec3> mean;
  for (const Moments& m : all) mean.push_back(vec3(m.mean()) * (kPi / kAlbedo));
  return mean;
}

/// The mean of that.
vec3 irradiance(const Scene& scene, std::uint32_t samples, std::uint32_t seed = 0) {
  dvec3 sum(0.0);
  for (const vec3& p : picture(scene, samples, seed)) sum += dvec3(p);
  return vec3(sum / double(kSide * kSide));
}

/// A dark floor of half side 4 m, seen straight down from `height`: a square of `width` about
/// (x, 0, 0).
Scene floorFrom(float height, float x, float width) {
  Scene scene;
  scene.materials = {test::lambert(kAlbedo)};
  test::place(scene, test::sheet(4.0f, 0.0f, 0));
  Camera camera = test::lookAt(dvec3(x, height, 0.0), dvec3(x, 0.0, 0.0), 0.5f);
  camera.orthographic = true;
  camera.orthographicHeight = width;
  scene.cameras = {camera};
  return scene;
}

Material mirror() {
  Material m;
  m.roughness = 0.0f;
  return m;
}

/// Irradiance of a floor at (x, 0, z) from a point light of intensity 1 at (lx, ly, 0).
double fromPoint(double x, double z, double lx, double ly) {
  const double d2 = (x - lx) * (x - lx) + ly * ly + z * z;
  return ly / (d2 * std::sqrt(d2));
}

/// A wall at x = -1.
void placeMirror(Scene& scene) {
  scene.materials.push_back(mirror());
  Mesh wall;
  wall.material = 1;
  wall.positions = {vec3(-1, 0, -4), vec3(-1, 0, 4), vec3(-1, 4, 4), vec3(-1, 4, -4)};
  wall.triangles = {{0, 2, 1}, {0, 3, 2}};
  test::place(scene, wall);
}

TEST(Caustics, AMirrorShowsAnImageOfTheLight) {
  Scene scene = floorFrom(0.5f, 0.3f, 0.4f);
  placeMirror(scene);
  scene.lights = {test::pointLight(dvec3(0.0, 1.0, 0.0), 5.0f)};
  double direct = 0.0, image = 0.0;
  for (int i = 0; i < 400; ++i) {
    const double x = 0.1 + 0.02 * (i % 20 + 0.5), z = -0.2 + 0.02 * (i / 20 + 0.5);
    direct += 5.0 * fromPoint(x, z, 0.0, 1.0) / 400.0;
    image += 5.0 * fromPoint(x, z, -2.0, 1.0) / 400.0;
  }
  EXPECT_NEAR((irradiance(scene, 32).x - direct) / image, 1.0, 0.03);
}

/// Turns of the light and of the eye's ray count together: seen straight, the image's light has
/// turned two times, seen by the mirror three times.
TEST(Caustics, TheirTurnsCount) {
  Scene scene = floorFrom(0.5f, 0.0f, 0.02f);
  placeMirror(scene);
  scene.lights = {test::pointLight(dvec3(0.0, 1.0, 0.0), 5.0f)};
  const double direct = 5.0 * fromPoint(0.0, 0.0, 0.0, 1.0),
               image = 5.0 * fromPoint(0.0, 0.0, -2.0, 1.0);
  for (const std::uint32_t mirrors : {0u, 1u}) {
    if (mirrors > 0) scene.cameras = {test::lookAt(dvec3(0, 0.5, 0), dvec3(-1, 0.25, 0), 0.02f)};
    for (std::uint32_t most = 0; most <= 3; ++most) {
      scene.maxBounces = most;
      const double right = most < 1 + mirrors ? 0.0 : most == 1 + mirrors ? direct : direct + image;
      EXPECT_NEAR(irradiance(scene, 16).x, right, 0.2 * image) << mirrors << ' ' << most;
    }
  }
}

/// What is reflected to and fro inside a pane is bent, what passes is not: together (1 - R) / (1 +
/// R), so nothing is counted twice.
TEST(Caustics, SunThroughAPaneIsWholeAndOnce) {
  for (const float angle : {0.0f, 1.2f}) {
    Scene scene = floorFrom(0.2f, 0.0f, 0.4f);
    scene.materials.push_back(test::glass(true));
    test::place(scene, test::pane(4.0f, 0.3f, 0.02f, 1));
    scene.lights = {test::sun(vec3(std::sin(angle), -std::cos(angle), 0.0f), 2.0f)};
    const float once = fresnelDielectric(std::cos(angle), 1.5f);
    const float right = 2.0f * std::cos(angle) * (1.0f - once) / (1.0f + once);
    EXPECT_NEAR(irradiance(scene, angle > 0.0f ? 64 : 8).x / right, 1.0f, 0.01f) << angle;
  }
}

/// Sunlight that a glass ball throws on the floor below it: all that enters and leaves again, but
/// for what lands outside of the picture or is reflected inside.
TEST(Caustics, EnergyBelowAGlassBall) {
  constexpr double kRadius = 0.5, kHeight = 0.9, kHalf = 1.2;
  Scene scene = floorFrom(0.3f, 0.0f, 2.0f * static_cast<float>(kHalf));
  scene.materials.push_back(test::glass(true));
  test::place(scene, test::sphere(vec3(0.0f, static_cast<float>(kHeight), 0.0f),
                                  static_cast<float>(kRadius), 1, 64));
  scene.lights = {test::sun(vec3(0.0f, -1.0f, 0.0f), 1.0f)};
  double power = 4.0 * kHalf * kHalf - std::numbers::pi * kRadius * kRadius;  // beside the ball
  constexpr int kRings = 2000;
  for (int i = 0; i < kRings; ++i) {
    const double r = (i + 0.5) / kRings, outside = std::asin(r), inside = std::asin(r / 1.5);
    const double turn = 2.0 * (outside - inside);
    // Where the ray leaves the ball, and where it lands.
    const double leave = outside - 2.0 * inside;  // angle from the axis downwards, on the far side
    const double x = kRadius * std::sin(leave), y = kHeight - kRadius * std::cos(leave);
    if (turn >= 0.5 * std::numbers::pi) continue;
    const double land = std::abs(x - y * std::tan(turn));
    const double once = 1.0 - fresnelDielectric(static_cast<float>(std::cos(outside)), 1.5f);
    double share = 1.0;  // of the ring that lands in the square
    if (land > kHalf)
      share = std::max(
          0.0, 1.0 - 8.0 / (2.0 * std::numbers::pi) * std::acos(std::min(1.0, kHalf / land)));
    power += once * once * share * 2.0 * std::numbers::pi * r / kRings * kRadius * kRadius;
  }
  EXPECT_NEAR(irradiance(scene, 32).x * 4.0 * kHalf * kHalf / power, 1.0, 0.01);
}

/// A point light straight over a glass ball: what enters the ball, by angle, lands where refraction
/// sends it.
class PointOverABall : public ::testing::Test {
 protected:
  static constexpr double kRadius = 0.5, kHeight = 0.9, kLight = 2.4, kHalf = 0.8;

  PointOverABall() {
    scene_.materials.push_back(test::glass(true));
    test::place(scene_, test::sphere(vec3(0.0f, static_cast<float>(kHeight), 0.0f),
                                     static_cast<float>(kRadius), 1, 64));
    scene_.lights = {test::pointLight(dvec3(0.0, kLight, 0.0), 1.0f)};
  }
  /// Share of a ring around the axis that lies in the picture.
  static double inPicture(double radius) {
    if (radius <= kHalf) return 1.0;
    return std::max(0.0, 1.0 - 4.0 / std::numbers::pi * std::acos(std::min(1.0, kHalf / radius)));
  }
  /// Power that arrives in the picture, W.
  static double power() {
    constexpr int kRings = 20000;
    double sum = 0.0;
    for (int i = 0; i < kRings; ++i) {
      const double step = 0.8 / kRings, angle = (i + 0.5) * step;
      const double sent = 2.0 * std::numbers::pi * std::sin(angle) * step;
      const double miss = (kLight - kHeight) * std::sin(angle) / kRadius;
      if (miss >= 1.0) {
        sum += sent * inPicture(kLight * std::tan(angle));
        continue;
      }
      const double outside = std::asin(miss), inside = std::asin(miss / 1.5);
      const double exit = outside - angle + std::numbers::pi - 2.0 * inside;  // from above, at
      const double x = kRadius * std::sin(exit);                              // the centre
      const double y = kHeight + kRadius * std::cos(exit);
      const double last = angle - 2.0 * (outside - inside);  // from straight down
      if (std::abs(last) >= 0.5 * std::numbers::pi) continue;
      const double once = 1.0 - fresnelDielectric(static_cast<float>(std::cos(outside)), 1.5f);
      sum += sent * once * once * inPicture(std::abs(x + y * std::tan(last)));
    }
    return sum;
  }
  Scene scene_ = floorFrom(0.3f, 0.0f, 2.0f * static_cast<float>(kHalf));
};

TEST_F(PointOverABall, EnergyIsThatOfRefraction) {
  EXPECT_NEAR(irradiance(scene_, 16).x * 4.0 * kHalf * kHalf / power(), 1.0, 0.02);
}

/// The pattern comes closer and closer to what many samples with other photons show: with a bias
/// alone, or noise alone that stays, four times the samples would not halve the error's square.
TEST_F(PointOverABall, ErrorFallsWithTheNumberOfSamples) {
  const std::vector<vec3> right = picture(scene_, 48, 7);
  double before = 1e30;
  for (const std::uint32_t samples : {1u, 4u, 16u}) {
    const std::vector<vec3> got = picture(scene_, samples);
    double sum = 0.0, scale = 0.0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      const double d = static_cast<double>(got[i].x - right[i].x),
                   r = static_cast<double>(right[i].x);
      sum += d * d;
      scale += r * r;
    }
    const double error = sum / scale;
    EXPECT_LT(error, 0.5 * before) << samples;
    before = error;
  }
  EXPECT_LT(before, 0.03);
}

/// A ball of half a millimetre on a floor of 8 m throws the pattern of one of half a metre.
TEST_F(PointOverABall, PatternsAreAsSharpInLargeScenes) {
  constexpr float kScale = 1e-3f;
  Scene small = floorFrom(0.3f * kScale, 0.0f, 2.0f * kScale * static_cast<float>(kHalf));
  small.materials.push_back(test::glass(true));
  test::place(small, test::sphere(vec3(0.0f, kScale * static_cast<float>(kHeight), 0.0f),
                                  kScale * static_cast<float>(kRadius), 1, 64));
  small.lights = {test::pointLight(dvec3(0.0, kLight * double(kScale), 0.0), kScale * kScale)};
  const std::vector<vec3> right = picture(scene_, 24), got = picture(small, 24);
  double sum = 0.0, scale = 0.0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    sum += static_cast<double>((got[i].x - right[i].x) * (got[i].x - right[i].x));
    scale += static_cast<double>(right[i].x * right[i].x);
  }
  EXPECT_LT(sum / scale, 0.05);
}

/// Of all directions of the light a hundred-thousandth meets the mirror.
TEST(Caustics, PhotonsAreAimedAtSmallMirrors) {
  Scene scene = floorFrom(0.5f, 2.0f, 0.1f);
  scene.materials.push_back(mirror());
  Mesh small = test::sheet(0.01f, 0.05f, 1);
  for (vec3& p : small.positions) p.x += 1.0f;
  test::place(scene, small);
  test::place(scene, test::sheet(4.0f, 1.5f, 0));
  scene.lights = {test::pointLight(dvec3(0.0, 1.0, 0.0), 5.0f)};
  scene.lights[0].range = 2.0f;  // as light sampling at the mirror cuts it
  const RayScene rays(scene);
  constexpr std::uint32_t kCount = 4096;
  const auto photons = CausticLights(scene, WalkTracer(rays), 0).shoot(0, 0, kCount);
  EXPECT_GT(photons.size(), kCount / 16);
  double power = 0.0;
  for (const CausticPhoton& p : photons) power += p.power.x / kCount;
  const double distance2 = 1.0 + 0.95 * 0.95;
  const double cut = 1.0 - distance2 * distance2 / 16.0;
  EXPECT_NEAR(power / (cut * 5.0 * 4e-4 * 0.95 / (distance2 * std::sqrt(distance2))), 1.0, 0.05);
}

/// A low mirror throws light on a strip of floor before it, a hundredth of all that is bent.
/// However few photons that is, none of it is seen farther away.
TEST(Caustics, LightOfNearMirrorsStaysThere) {
  Scene scene = floorFrom(0.5f, 0.2f, 0.2f);
  scene.materials.push_back(mirror());
  for (const vec2& wall : {vec2(0.0f, 0.02f), vec2(-3.9f, 2.0f)}) {  // its x, and how high it is
    Mesh mesh;
    mesh.material = 1;
    mesh.positions = {vec3(wall.x, 0.0f, -4.0f), vec3(wall.x, 0.0f, 4.0f),
                      vec3(wall.x, wall.y, 4.0f), vec3(wall.x, wall.y, -4.0f)};
    mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
    test::place(scene, mesh);
  }
  scene.lights = {test::sun(glm::normalize(vec3(-1.0f, -1.0f, 0.0f)), 1.0f)};
  EXPECT_NEAR(irradiance(scene, 8).x * std::sqrt(2.0f), 1.0f, 1e-3f);
}

/// The guess's photons end where their light does, behind a pane too.
TEST(Caustics, PhotonsKeepToTheRangeOfTheirLight) {
  for (const bool behindPane : {false, true}) {
    Scene scene = floorFrom(1.0f, 0.0f, 1.0f);
    scene.materials.push_back(test::glass(false));
    scene.materials[1].ior = 1.0f;
    if (behindPane) test::place(scene, test::sheet(4.0f, 0.5f, 1));
    scene.lights = {test::pointLight(dvec3(0.0, 1.0, 0.0), 1.0f)};
    scene.lights[0].range = 2.0f;
    const RayScene rays(scene);
    const LightSet lights(scene, rays);
    constexpr std::uint32_t kCount = 20000;
    double landed = 0.0, sampled = 0.0;
    const auto photons = landPhotons(scene, WalkTracer(rays), lights, 0, 0, kCount, false);
    for (const LandedPhoton& p : *photons) {
      landed += double(p.power.x) / kCount;
    }
    constexpr int kCells = 200;
    for (int i = 0; i < kCells * kCells; ++i) {
      const double x = 2.0 * ((i % kCells + 0.5) * 2.0 / kCells - 1.0),
                   z = 2.0 * ((i / kCells + 0.5) * 2.0 / kCells - 1.0), d2 = x * x + z * z + 1.0;
      sampled += fromPoint(x, z, 0.0, 1.0) * std::max(0.0, 1.0 - d2 * d2 / 16.0) * 16.0 /
                 (kCells * kCells);
    }
    EXPECT_NEAR(landed / sampled, 1.0, 0.03) << behindPane;
  }
}

/// Mean radiosity, 1/m^2, at these points (of a number in [0, 1)^2, evenly), seen from above, by
/// photons of 1 W in all that have landed there.
template <typename Points>
double taken(const Scene& scene, const Points& points, bool blurred) {
  constexpr std::uint32_t kCount = 4096;
  const RayScene rays(scene);
  const vec3 up(0.0f, 1.0f, 0.0f);
  std::vector<CausticPhoton> photons;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    photons.push_back(
        {points(Sampler(7, i, 0).next2D()), up, up, vec3(1.0f / kCount), blurred, 2, kInfinity});
  }
  const CausticWidths widths(photons, 1.0f, 1e9);  // the widest: 0.1 m
  const CausticMap map(scene, photons, widths, 1.0f, WalkTracer(rays));
  double sum = 0.0;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    const vec3 from = points((vec2(i % 64, i / 64) + 0.5f) / 64.0f);
    RayHit hit;
    EXPECT_TRUE(rays.intersect(from + 1e-4f * up, -up, 0.0f, kInfinity, hit));
    const Surface surface = rays.surface(hit);
    const vec3 at(surface.position);
    sum += static_cast<double>(map.radiance(at, map.near(at), Bsdf(scene, surface, up), true).x);
  }
  return sum * kPi / kCount;
}

/// Tiles and ribbons narrower than the photons' disks take all of their light.
class EdgesOfDisks : public testing::TestWithParam<vec2> {};

TEST_P(EdgesOfDisks, LoseNoLight) {
  Scene scene;
  scene.materials = {test::lambert(1.0f)};
  const vec3 half(GetParam().x, 0.0f, GetParam().y);
  Mesh tile = test::sheet(1.0f, 0.0f, 0);
  for (vec3& p : tile.positions) p *= half;
  test::place(scene, tile);
  const auto points = [&](vec2 u) {
    return half * vec3(2.0f * u.x - 1.0f, 0.0f, 2.0f * u.y - 1.0f);
  };
  EXPECT_NEAR(taken(scene, points, false) * 4.0 * double(half.x) * double(half.z), 1.0, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Caustics, EdgesOfDisks,
                         testing::Values(vec2(0.2f, 0.2f), vec2(0.05f, 0.05f), vec2(0.01f, 0.01f),
                                         vec2(0.5f, 0.01f), vec2(0.5f, 0.002f),
                                         vec2(0.001f, 0.001f)));

/// Strips of metal between those of the tile take no photon, so the others take all; of photons
/// that are not blurred rough metal takes its part.
TEST(Caustics, DisksLoseNoLightToMetal) {
  constexpr float kStrip = 0.02f;
  Scene scene;
  scene.materials = {test::lambert(1.0f), mirror(), mirror()};
  scene.materials[2].roughness = 0.3f;
  for (const std::uint32_t metal : {1u, 2u}) {
    scene.meshes.clear();
    scene.instances.clear();
    for (int i = -10; i < 10; ++i) {
      Mesh strip = test::sheet(0.5f * kStrip, 0.0f, i % 2 == 0 ? 0 : metal);
      for (vec3& p : strip.positions)
        p = vec3(p.x + (static_cast<float>(i) + 0.5f) * kStrip, 0, 20.0f * p.z);
      test::place(scene, strip);
    }
    const auto points = [&](vec2 u) {
      const float at = u.x * 10.0f, strip = std::min(std::floor(at), 9.0f);
      return vec3((2.0f * strip - 10.0f + at - strip) * kStrip, 0.0f, 0.4f * u.y - 0.2f);
    };
    EXPECT_NEAR(taken(scene, points, true) * 0.4 * 10.0 * double(kStrip), 1.0, 0.03) << metal;
  }
}

/// A sheet of paper on a desk: what the desk beneath it takes is not missing on the paper.
TEST(Caustics, DisksKeepTheirLightOnWhatIsSeen) {
  Scene scene;
  scene.materials = {test::lambert(1.0f)};
  test::place(scene, test::sheet(0.2f, 0.0f, 0));
  test::place(scene, test::sheet(0.2f, -0.001f, 0));
  const auto points = [](vec2 u) { return vec3(0.4f * u.x - 0.2f, 0.0f, 0.4f * u.y - 0.2f); };
  EXPECT_NEAR(taken(scene, points, false) * 0.16, 1.0, 0.03);
}

/// Photons land on what alpha leaves of a sheet, and so tell its part of the light that comes: the
/// sheet's own shading takes its part again.
TEST(Caustics, DisksKnowOfAlpha) {
  for (const float alpha : {0.5f, 0.1f}) {
    Scene scene;
    scene.materials = {test::lambert(1.0f)};
    scene.materials[0].baseColor.a = alpha;
    scene.materials[0].alphaMode = AlphaMode::kBlend;
    test::place(scene, test::sheet(0.2f, 0.0f, 0));
    const auto points = [](vec2 u) { return vec3(0.4f * u.x - 0.2f, 0.0f, 0.4f * u.y - 0.2f); };
    EXPECT_NEAR(taken(scene, points, false) * 0.16 * double(alpha), 1.0, 0.03) << alpha;
  }
}

/// Widths that near() leaves out bring nothing; where no photon is, none is left.
TEST(Caustics, WidthsThatAreNotNearBringNothing) {
  Scene scene = floorFrom(0.3f, 0.0f, 1.0f);
  const RayScene rays(scene);
  const vec3 up(0.0f, 1.0f, 0.0f);
  // Denser and denser towards one corner of a square: disks of many widths.
  std::vector<CausticPhoton> photons;
  for (std::uint32_t i = 0; i < 4096; ++i) {
    const vec2 u = Sampler(11, i, 0).next2D();
    photons.push_back({vec3(std::pow(u.x, 4.0f), 0.0f, std::pow(u.y, 4.0f)), up, up,
                       vec3(1.0f / 4096.0f), false, 2, kInfinity});
  }
  const CausticWidths widths(photons, 4.0f, 16.0);
  const CausticMap map(scene, photons, widths, 0.8f, WalkTracer(rays));
  std::uint32_t all = 0, seen = 0, left = 0;
  for (std::uint32_t i = 0; i < 4096; ++i) {
    const vec2 u = Sampler(12, i, 0).next2D();
    all |= map.near(vec3(std::pow(u.x, 4.0f), 0.0f, std::pow(u.y, 4.0f)));
  }
  EXPECT_GE(std::popcount(all), 5);
  for (std::uint32_t i = 0; i < 4096; ++i) {
    const vec2 u = 8.0f * Sampler(13, i, 0).next2D() - 4.0f;
    const vec3 from(u.x, 0.5f, u.y);
    RayHit hit;
    if (!rays.intersect(from, -up, 0.0f, kInfinity, hit)) continue;
    const Surface surface = rays.surface(hit);
    const Bsdf bsdf(scene, surface, up);
    const vec3 at(surface.position);
    const std::uint32_t near = map.near(at);
    EXPECT_EQ(map.radiance(at, near, bsdf, true), map.radiance(at, near | all, bsdf, true));
    // The floor is matte: the same without a Bsdf.
    EXPECT_EQ(map.radiance(at, near, bsdf, true),
              map.radiance(at, near, MatteSurface{vec3(kAlbedo), up, up, up}));
    seen += near != 0 && map.radiance(at, near, bsdf, true).x > 0.0f;
    left += near == 0;
  }
  EXPECT_GT(seen, 100u);
  EXPECT_GT(left, 2000u);
}

TEST(Caustics, MapsDependOnNothingButTheirNumber) {
  Scene scene = floorFrom(0.3f, 0.0f, 1.0f);
  scene.materials.push_back(test::glass(true));
  test::place(scene, test::sphere(vec3(0.0f, 0.6f, 0.0f), 0.2f, 1, 16));
  scene.lights = {test::pointLight(dvec3(0.5, 2.0, 0.0), 5.0f)};
  const RayScene rays(scene);
  const WalkTracer walks(rays);
  CausticMaps forward(scene, walks, 1024, 3), single(scene, walks, 1024, 3);
  for (std::uint32_t s = 0; s < 5; ++s) forward.prepare({&s, 1});
  const std::uint32_t last = 4;
  single.prepare({&last, 1});
  const SampleCaustics *a = forward.find(last), *b = single.find(last);
  ASSERT_NE(a, nullptr);
  ASSERT_NE(b, nullptr);
  ASSERT_EQ(a->seen->size(), b->seen->size());
  ASSERT_EQ(a->later->size(), b->later->size());
  EXPECT_GT(a->seen->size(), 250u);
  EXPECT_NEAR(double(a->later->size()) / double(a->seen->size()), 0.25, 0.05);
  EXPECT_NE(forward.find(3), nullptr);
  EXPECT_EQ(forward.find(5), nullptr);
  EXPECT_EQ(single.find(3), nullptr);
}

/// A room of matte walls but for one of `material` on the left, which the camera sees as well as
/// what it throws on the others.
Scene roomWithWall(const Material& material, bool mirrorToo) {
  Scene scene;
  scene.materials = {test::lambert(0.5f), material, mirror()};
  for (Mesh& m : std::vector<Mesh>{test::sheet(1.0f, -1.0f, 0), test::sheet(1.0f, 1.0f, 0)}) {
    test::place(scene, m);
  }
  const auto wall = [&](vec3 a, vec3 b, vec3 c, vec3 d, int of) {
    Mesh mesh;
    mesh.material = of;
    mesh.positions = {a, b, c, d};
    mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    test::place(scene, mesh);
  };
  wall(vec3(-1, -1, -1), vec3(-1, 1, -1), vec3(-1, 1, 1), vec3(-1, -1, 1), 1);
  wall(vec3(1, -1, -1), vec3(1, -1, 1), vec3(1, 1, 1), vec3(1, 1, -1), 0);
  wall(vec3(-1, -1, -1), vec3(1, -1, -1), vec3(1, 1, -1), vec3(-1, 1, -1), mirrorToo ? 2 : 0);
  // Neither the light nor its image in the back wall is seen.
  scene.cameras = {test::lookAt(dvec3(0.3, -0.5, 1.5), dvec3(-1.0, -0.5, 0.0), 0.7f)};
  scene.lights = {test::pointLight(dvec3(0.2, 0.5, 0.1), 1.0f)};
  return scene;
}

struct Estimate {
  double mean, error;
};

/// Mean of a picture and its standard error, by samples.
Estimate brightness(const Scene& scene, std::uint32_t samples, bool withMaps) {
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), kSide, kSide);
  const WalkTracer walks(rays);
  CausticMaps maps(scene, walks, kSide * kSide, 0);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, withMaps ? 1 : 2, true,
                          withMaps ? &maps : nullptr);
  double sum = 0.0, squares = 0.0;
  for (std::uint32_t s = 0; s < samples; ++s) {
    if (withMaps) maps.prepare({&s, 1});
    dvec3 picture(0.0);
    for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
      picture += dvec3(tracer.sample({i % kSide, i / kSide, s}, kSide).common);
    }
    const double value = (picture.x + picture.y + picture.z) / (3.0 * kSide * kSide);
    sum += value, squares += value * value;
  }
  const double mean = sum / samples;
  return {mean, std::sqrt(std::max(0.0, squares / samples - mean * mean) / (samples - 1))};
}

Material nearMirror(float metallic, float transmission) {
  Material m;
  m.metallic = metallic;
  m.roughness = 0.3f;
  m.transmission = transmission;
  m.doubleSided = true;
  return m;
}

/// Photons and paths share what near mirrors throw, so that nothing is lost or counted twice: the
/// same light as light sampling finds alone, with less noise.
TEST(Caustics, NearMirrorsThrowWhatTheyThrowWithoutPhotons) {
  Material lacquer = nearMirror(0.0f, 0.0f);
  lacquer.ior = 2.5f;
  lacquer.baseColor = vec4(0.6f, 0.3f, 0.2f, 1.0f);
  for (const Material& m : {nearMirror(1.0f, 0.0f), lacquer, nearMirror(0.0f, 1.0f)}) {
    const Scene scene = roomWithWall(m, false);
    const Estimate with = brightness(scene, 64, true), without = brightness(scene, 128, false);
    EXPECT_NEAR(with.mean / without.mean, 1.0, 0.005 + 4.0 * without.error / without.mean)
        << m.metallic << " " << m.transmission;
    EXPECT_LT(4.0 * without.error / without.mean, 0.03);
  }
}

/// Normals of a curved near mirror that its triangles do not follow.
TEST(Caustics, BentNormalsThrowWhatTheyThrowWithoutPhotons) {
  Scene scene = roomWithWall(nearMirror(1.0f, 0.0f), false);
  for (Mesh& mesh : scene.meshes) {
    if (mesh.material != 1) continue;
    for (const vec3& p : mesh.positions) {
      mesh.normals.push_back(glm::normalize(vec3(1.0f, 0.7f + 0.3f * p.y, 0.3f * p.z)));
    }
  }
  const Estimate with = brightness(scene, 64, true), without = brightness(scene, 128, false);
  EXPECT_NEAR(with.mean / without.mean, 1.0, 0.005 + 4.0 * without.error / without.mean);
  EXPECT_LT(4.0 * without.error / without.mean, 0.03);
}

/// Near mirrors and mirrors together against a small lamp, which paths find.
TEST(Caustics, NearMirrorsAndMirrorsAsOfASmallLamp) {
  Scene scene = roomWithWall(nearMirror(1.0f, 0.0f), true);
  constexpr float kRadius = 0.1f;
  const Estimate point = brightness(scene, 64, true);
  Material lamp = test::lambert(0.0f);
  lamp.emission = vec3(1.0f / (kPi * kRadius * kRadius));
  scene.materials.push_back(lamp);
  test::place(scene, test::sphere(vec3(scene.lights[0].position), kRadius, 3, 24));
  scene.lights.clear();
  const Estimate ball = brightness(scene, 500, false);
  EXPECT_NEAR(point.mean / ball.mean, 1.0, 0.02 + 3.0 * ball.error / ball.mean);
  EXPECT_LT(3.0 * ball.error / ball.mean, 0.035);
}

TEST(Caustics, OnlyWhereLightsArePointsAndSomethingBendsThem) {
  Scene scene = floorFrom(0.3f, 0.0f, 1.0f);
  EXPECT_FALSE(CausticMaps::needed(scene));
  scene.lights = {test::pointLight(dvec3(0.5, 2.0, 0.0), 5.0f)};
  EXPECT_FALSE(CausticMaps::needed(scene));
  scene.materials.push_back(mirror());
  EXPECT_TRUE(CausticMaps::needed(scene));
  scene.lights.clear();
  EXPECT_FALSE(CausticMaps::needed(scene));
}

}  // namespace
}  // namespace trex
