#include "src/crays/emitters.h"

#include <gtest/gtest.h>

#include <functional>

#include "src/frame/estimator.h"
#include "src/paths/path_tracer.h"
#include "tests/unit/chi_square.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

Image picture(int width, int height, int channels,
              const std::function<std::uint8_t(int, int, int)>& value) {
  Image image;
  image.width = width;
  image.height = height;
  image.channels = channels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) image.bytes.push_back(value(x, y, c));
    }
  }
  return image;
}

/// A floor of albedo 0.8 and, 2 m above it, a lamp of 1 m that shines down with radiance 1.
Scene room(float lampHalf) {
  Scene scene;
  scene.materials = {test::lambert(0.8f), test::lambert(0.0f, 1.0f)};
  test::place(scene, test::panel(-3.0f, 3.0f, 0.0f, 0, true));
  test::place(scene, test::panel(-lampHalf, lampHalf, 2.0f, 1, false));
  return scene;
}

void texture(Scene& scene, Texture& slot, Image image, bool clamp = true) {
  slot.image = static_cast<int>(scene.images.size());
  if (clamp) slot.wrapS = slot.wrapT = Texture::Wrap::kClamp;
  scene.images.push_back(std::move(image));
}

/// Radiance of the floor at (x, 0, 0) by the exact mode; light sampling and rays that find the lamp
/// by chance together.
double floorAt(const Scene& scene, double x, double* deviation = nullptr) {
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  Camera eye = test::lookAt(dvec3(x, 1.0, 1.5), dvec3(x, 0.0, 0.0), 0.005f);
  const CameraRays camera(eye, rays.renderOrigin(), 8, 8);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
  Moments all;
  for (std::uint32_t s = 0; s < 1024; ++s) {
    for (std::uint32_t p = 0; p < 64; ++p) {
      all.add(tracer.sample({p % 8, p / 8, s}, 8).common);
    }
  }
  if (deviation) *deviation = std::sqrt(all.varianceOfMean().x);
  return static_cast<double>(all.mean().x);
}

/// The closed form: what a horizontal lamp at height 2 gives at (x, 0, 0), of radiance
/// sent(x, z).
double expectedAt(double x, double half, const std::function<double(double, double)>& sent) {
  constexpr int kSteps = 800;
  double sum = 0.0;
  const double step = 2.0 * half / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const double u = -half + (i + 0.5) * step, v = -half + (j + 0.5) * step;
      const double distance2 = (u - x) * (u - x) + v * v + 4.0;
      sum += sent(u, v) * 4.0 / (distance2 * distance2) * step * step;
    }
  }
  return 0.8 / std::numbers::pi * sum;
}

void expectFloor(const Scene& scene, double x, double half,
                 const std::function<double(double, double)>& sent) {
  const double right = expectedAt(x, half, sent);
  double deviation = 0.0;
  EXPECT_NEAR(floorAt(scene, x, &deviation), right, 0.01 * right);
  EXPECT_LT(deviation, 0.005 * right);
}

TEST(Emitters, ATexturesPlaceOnAnAtlasCounts) {
  Scene scene = room(0.5f);
  texture(scene, scene.materials[1].emissiveTexture,
          picture(8, 8, 3, [](int x, int y, int) { return x < 2 && y < 2 ? 255 : 0; }));
  for (vec2& uv : scene.meshes[1].texCoords) uv = 0.08f + 0.06f * uv;  // inside the white part
  expectFloor(scene, 0.0, 0.5, [](double, double) { return 1.0; });
}

TEST(Emitters, AHalfBlackPanelShinesWithTheOther) {
  Scene scene = room(1.0f);
  texture(scene, scene.materials[1].emissiveTexture,
          picture(64, 2, 3, [](int x, int, int) { return x < 32 ? 0 : 255; }));
  const auto sent = [](double x, double) {  // bilinear between the two texels at the middle
    return std::clamp(0.5 + x * 32.0, 0.0, 1.0);
  };
  expectFloor(scene, -2.0, 1.0, sent);
  expectFloor(scene, 2.0, 1.0, sent);
}

TEST(Emitters, APictureOnTheSecondSetShinesWhereThatSays) {
  Scene scene = room(1.0f);
  Mesh& lamp = scene.meshes[1];
  lamp.secondTexCoords = lamp.texCoords;
  for (vec2& uv : lamp.texCoords) uv = vec2(0.9f * uv.y, 0.2f);
  Material& m = scene.materials[1];
  texture(scene, m.emissiveTexture,
          picture(64, 2, 3, [](int x, int, int) { return x < 32 ? 0 : 255; }));
  m.emissiveTexture.set = 1;
  const auto sent = [](double x, double) { return std::clamp(0.5 + x * 32.0, 0.0, 1.0); };
  expectFloor(scene, -2.0, 1.0, sent);
  // A cut by the first set: what is left is where its u is over a half, at z over 1/9.
  m.alphaMode = AlphaMode::kMask;
  texture(scene, m.baseColorTexture,
          picture(2, 2, 4, [](int x, int, int c) { return c < 3 || x == 1 ? 255 : 0; }));
  expectFloor(scene, 0.5, 1.0,
              [&](double x, double z) { return 0.9 * (z + 1.0) / 2.0 >= 0.5 ? sent(x, z) : 0.0; });
}

TEST(Emitters, CutOutLampsShineWhereTheyAre) {
  Scene scene = room(0.5f);
  scene.materials[1].alphaMode = AlphaMode::kMask;
  scene.materials[1].baseColor.w = 0.2f;
  EXPECT_EQ(floorAt(scene, 0.0), 0.0);  // wholly cut away
  scene.materials[1].baseColor.w = 1.0f;
  texture(scene, scene.materials[1].baseColorTexture,
          picture(2, 2, 4, [](int x, int, int c) { return c < 3 || x == 1 ? 255 : 0; }));
  expectFloor(scene, 0.7, 0.5, [](double x, double) { return x >= 0.0 ? 1.0 : 0.0; });
}

TEST(Emitters, BlendedLampsShineWithWhatIsThere) {
  Scene scene = room(0.5f);
  scene.materials[1].alphaMode = AlphaMode::kBlend;
  scene.materials[1].baseColor.w = 0.5f;
  expectFloor(scene, 0.0, 0.5, [](double, double) { return 0.5; });
  // Vertex colours: alpha 0 on the left, 1 on the right.
  scene.materials[1].baseColor.w = 1.0f;
  scene.meshes[1].colors = {
      {255, 255, 255, 0}, {255, 255, 255, 255}, {255, 255, 255, 255}, {255, 255, 255, 0}};
  expectFloor(scene, 0.4, 0.5, [](double x, double) { return x + 0.5; });
  scene.materials[1].doubleSided = true;
  expectFloor(scene, 0.4, 0.5, [](double x, double) { return x + 0.5; });
}

/// A lamp of 1 m at (x, 1.5, 0), of a material of its own.
Material& addLamp(Scene& scene, float x) {
  Mesh mesh = test::panel(-0.5f, 0.5f, 1.5f, static_cast<int>(scene.materials.size()), false);
  mesh.origin = dvec3(x, 0.0, 0.0);
  test::place(scene, std::move(mesh));
  scene.materials.push_back(test::lambert(0.3f, 2.0f));
  return scene.materials.back();
}

/// A picture, a cut-out, and glass that shines on its coloured side, in a box.
Scene threeLamps() {
  Scene scene;
  scene.materials = {test::lambert(0.6f)};
  test::place(scene, test::box(vec3(-2.5f, 0.0f, -1.5f), vec3(2.5f, 2.0f, 1.5f), 0, true));
  texture(scene, addLamp(scene, -1.3f).emissiveTexture,
          picture(8, 8, 3, [](int x, int y, int c) { return (x + y) % 3 == c % 2 ? 255 : 20; }));
  Material& cut = addLamp(scene, 0.0f);
  cut.alphaMode = AlphaMode::kMask;
  texture(scene, cut.baseColorTexture, picture(4, 4, 4, [](int x, int y, int c) {
            return c < 3 || (x ^ y) % 2 == 0 ? 255 : 0;
          }));
  Material& faint = addLamp(scene, 1.3f);
  faint.alphaMode = AlphaMode::kBlend;
  faint.doubleSided = true;
  scene.meshes.back().colors = {
      {255, 255, 255, 10}, {255, 90, 255, 250}, {40, 255, 255, 250}, {255, 255, 255, 10}};
  scene.cameras = {test::lookAt(dvec3(2.2, 1.2, 1.3), dvec3(-0.6, 0.7, -0.4), 1.3f)};
  return scene;
}

/// Exact pictures of 16x16 pixels; `lights` may know of none: rays then find all light by chance.
std::vector<Moments> exactPicture(const Scene& scene, const RayScene& rays,
                                  const LightSet& lights) {
  const CameraRays camera(scene.cameras.front(), rays.renderOrigin(), 16, 16);
  const PathTracer tracer(scene, rays, lights, camera, GuessOptions{}, 0);
  std::vector<Moments> pixels(256);
  for (std::uint32_t p = 0; p < 256; ++p) {
    for (std::uint32_t s = 0; s < 512; ++s) {
      pixels[p].add(tracer.sample({p % 16, p / 16, s}, 16).common);
    }
  }
  return pixels;
}

TEST(Emitters, LightSamplingAgreesWithRaysAlone) {
  const Scene scene = threeLamps();
  Scene dark = scene;
  for (Material& m : dark.materials) m.emission = vec3(0.0f);
  const RayScene rays(scene), darkRays(dark);
  const auto sampled = exactPicture(scene, rays, LightSet(scene, rays));
  const auto alone = exactPicture(scene, rays, LightSet(dark, darkRays));
  int beyond = 0;
  dvec3 difference(0.0), variance(0.0), noise(0.0), noiseAlone(0.0);
  for (std::size_t p = 0; p < sampled.size(); ++p) {
    const dvec3 d = sampled[p].mean() - alone[p].mean();
    const dvec3 v = sampled[p].varianceOfMean() + alone[p].varianceOfMean();
    for (int c = 0; c < 3; ++c) beyond += d[c] * d[c] > 12.0 * v[c];  // 3.5 deviations: 1 in 2000
    difference += d;
    variance += v;
    noise += sampled[p].varianceOfMean();
    noiseAlone += alone[p].varianceOfMean();
  }
  EXPECT_LE(beyond, 6);  // of 768
  for (int c = 0; c < 3; ++c) {
    EXPECT_LT(std::abs(difference[c]), 3.5 * std::sqrt(variance[c])) << c;
    EXPECT_LT(noise[c], 0.7 * noiseAlone[c]) << c;
  }
}

/// A few sparks on a black picture, seen through instances that turn and mirror it.
Scene sparks(const dmat4& placed) {
  Scene scene = room(1.0f);
  texture(scene, scene.materials[1].emissiveTexture, picture(64, 64, 3, [](int x, int y, int c) {
            return (x * 7 + y * 13) % 97 == 0 ? 255 - 60 * c : 0;
          }));
  scene.instances[1].transform = placed;
  return scene;
}

TEST(Emitters, PlacesFollowTheirDensity) {
  const Scene scene = sparks(dmat4(1.0));
  const RayScene rays(scene);
  const Emitters emitters(scene, rays);
  ASSERT_EQ(emitters.triangles().size(), 2u);
  for (const Emitters::Triangle& t : emitters.triangles()) {
    constexpr int kEdge = 24, kCount = 200000, kFine = 16;
    std::vector<double> counts(kEdge * kEdge, 0.0), expected(kEdge * kEdge, 0.0);
    const auto weightsOf = [&](const dvec3& p) {
      const vec3 d(p - t.corner), n = glm::cross(t.edge1, t.edge2);
      return vec2(glm::dot(glm::cross(d, t.edge2), n), glm::dot(glm::cross(t.edge1, d), n)) /
             glm::dot(n, n);
    };
    const auto cell = [](vec2 w) {
      const auto at = [](float x) { return std::clamp(static_cast<int>(x * kEdge), 0, kEdge - 1); };
      return static_cast<std::size_t>(at(w.x) * kEdge + at(w.y));
    };
    int wrong = 0;
    for (std::uint32_t i = 0; i < kCount; ++i) {
      Sampler sampler(i, 0, 1);
      const vec2 u = sampler.next2D();
      const Emitters::Place place = emitters.sample(t, u.x, u.y);
      const vec2 w = weightsOf(place.position);
      counts[cell(w)] += 1.0;
      // On the border of two cells the weights' last digits decide.
      wrong += std::abs(emitters.density(t, w.x, w.y) / place.density - 1.0f) > 1e-4f;
    }
    EXPECT_LT(wrong, kCount / 1000);
    constexpr int kSide = kEdge * kFine;
    for (int i = 0; i < kSide; ++i) {
      for (int j = 0; j < kSide - i; ++j) {
        for (const float shift : {1.0f / 3.0f, 2.0f / 3.0f}) {
          const vec2 w = (vec2(i, j) + shift) / static_cast<float>(kSide);
          if (w.x + w.y >= 1.0f) continue;
          expected[cell(w)] += static_cast<double>(emitters.density(t, w.x, w.y) * t.area) *
                               kCount / (static_cast<double>(kSide) * kSide);
        }
      }
    }
    EXPECT_GT(test::chiSquareP(counts, expected), 1e-3);
  }
}

/// Sampling knows where the sparks are: little is left to chance.
TEST(Emitters, APicturesSparksAreFound) {
  for (int k = 0; k < 3; ++k) {
    dmat4 placed(1.0);
    if (k == 1) placed[0][0] = -1.0;  // mirrored: it shines down still
    if (k == 2) placed[0] = {0.0, 0.0, 2.0, 0.0}, placed[2] = {-0.5, 0.0, 0.0, 0.0};
    const Scene scene = sparks(placed);
    const RayScene rays(scene);
    const LightSet lights(scene, rays);
    const LightPoint at(dvec3(0.2, 0.0, 0.1) - rays.renderOrigin(), vec3(0.0f, 1.0f, 0.0f));
    double sum = 0.0, squares = 0.0;
    int mismatches = 0;
    constexpr int kCount = 4000;
    for (std::uint32_t i = 0; i < kCount; ++i) {
      Sampler sampler(i, 0, 3);
      LightSample s;
      if (!lights.sample(at, sampler, s)) continue;
      const double e = static_cast<double>(luminance(s.radiance) * s.direction.y / s.pdf);
      sum += e / kCount;
      squares += e * e / kCount;
      RayHit hit;
      ASSERT_TRUE(rays.intersect(vec3(at.position()), s.direction, 1e-3f, kInfinity, hit));
      const float pdf = lights.pdfEmitter(at, hit, hit.t, s.direction.y);
      mismatches += std::abs(pdf / s.pdf - 1.0f) > 1e-3f;
    }
    EXPECT_LT(std::sqrt(squares - sum * sum) / sum, 1.3) << k;
    EXPECT_LT(mismatches, kCount / 50) << k;  // on borders of cells
  }
}

/// One texel of four millions, which samples of its triangle would step over; the other triangle of
/// the square, all black, is not asked in its place.
TEST(Emitters, ASparkOfALargePictureIsFound) {
  constexpr int kEdge = 2048;
  for (const auto& [column, row] : {std::pair(600, 1400), {1400, 600}, {1023, 1024}, {0, 0}}) {
    Scene scene = room(0.5f);
    texture(scene, scene.materials[1].emissiveTexture,
            picture(kEdge, kEdge, 1, [c = column, r = row](int x, int y, int) {
              return x == c && y == r ? 255 : 0;
            }));
    const RayScene rays(scene);
    const Emitters emitters(scene, rays);
    double power = 0.0;
    for (const Emitters::Triangle& t : emitters.triangles()) {
      constexpr std::uint32_t kCount = 20000;
      double sum = 0.0;
      for (std::uint32_t i = 0; i < kCount; ++i) {
        Sampler sampler(i, 0, 1);
        const vec2 u = sampler.next2D();
        const Emitters::Place place = emitters.sample(t, u.x, u.y);
        sum += static_cast<double>(place.radiance.x / place.density) / kCount;
      }
      power += sum;
      if (sum > 0.0) {
        EXPECT_GT(static_cast<double>(t.radiance * t.area), 0.2 * sum);
      }
    }
    const double texel = 1.0 / (static_cast<double>(kEdge) * kEdge);
    EXPECT_NEAR(power / texel, 1.0, 0.15) << column << ' ' << row;
  }
}

/// A lamp that an exporter wrote three times over, once with its triangles the other way round:
/// rays see one of them, and so does light sampling.
TEST(Emitters, LampsInOnePlaceShineOnce) {
  for (const bool both : {false, true}) {
    Scene scene = room(0.5f);
    scene.materials[1].doubleSided = both;
    test::place(scene, test::panel(-0.5f, 0.5f, 2.0f, 1, false));
    if (both) test::place(scene, test::panel(-0.5f, 0.5f, 2.0f, 1, true));
    // The same triangles again, from other corners on, of a material that is alike.
    scene.materials.push_back(scene.materials[1]);
    Mesh turned = test::panel(-0.5f, 0.5f, 2.0f, 2, false);
    for (auto& t : turned.triangles) std::rotate(&t[0], &t[1], &t[0] + 3);
    test::place(scene, turned);
    const RayScene rays(scene);
    EXPECT_EQ(Emitters(scene, rays).triangles().size(), 2u);
    expectFloor(scene, 0.0, 0.5, [](double, double) { return 1.0; });
  }
  Scene twoFaces = room(0.5f);  // each of two faces of a sheet shines for itself
  test::place(twoFaces, test::panel(-0.5f, 0.5f, 2.0f, 1, true));
  const RayScene rays(twoFaces);
  EXPECT_EQ(Emitters(twoFaces, rays).triangles().size(), 4u);
  expectFloor(twoFaces, 0.0, 0.5, [](double, double) { return 1.0; });
}

TEST(Emitters, PhotonsLeaveFromWhatShines) {
  Scene scene = room(1.0f);
  texture(scene, scene.materials[1].emissiveTexture,
          picture(64, 2, 3, [](int x, int, int) { return x < 32 ? 0 : 255; }));
  scene.materials[1].alphaMode = AlphaMode::kBlend;
  scene.materials[1].baseColor.w = 0.25f;
  const RayScene rays(scene);
  const LightSet lights(scene, rays);
  constexpr int kCount = 4000;
  double sum = 0.0;
  int dark = 0;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    Sampler sampler(1, i, 0);
    EmittedPhoton p;
    if (!lights.emit(sampler, p)) continue;
    EXPECT_LE(maxComponent(p.power), lights.largestPhotonPower() * 1.0001f);
    sum += static_cast<double>(p.power.x) / kCount;
    dark += p.start.position.x + rays.renderOrigin().x < -1.0 / 64.0;
  }
  EXPECT_NEAR(sum / (std::numbers::pi * 2.0 * 0.25), 1.0, 0.01);
  EXPECT_LT(dark, kCount / 50);
}

/// Hits of all triangles of many instances lead to the right one.
TEST(Emitters, HitsFindTheirTriangle) {
  Scene scene;
  scene.materials = {test::lambert(0.8f), test::lambert(0.0f, 1.0f)};
  scene.meshes.push_back(test::sphere(vec3(0.0f), 0.3f, 1, 24));
  for (int i = 0; i < 5; ++i) {
    Instance instance;
    instance.object = i;
    instance.transform[3] = glm::dvec4(i, 0.0, 0.0, 1.0);
    scene.instances.push_back(instance);
  }
  test::place(scene, test::sphere(vec3(0.0f, 2.0f, 0.0f), 0.5f, 1, 9));
  const RayScene rays(scene);
  const Emitters emitters(scene, rays);
  ASSERT_GT(emitters.triangles().size(), 5000u);
  int found = 0;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    Sampler sampler(i, 0, 3);
    const vec2 a = sampler.next2D(), b = sampler.next2D();
    const vec3 from = vec3(7.0f * a.x, 4.0f * a.y, 3.0f) - vec3(rays.renderOrigin());
    RayHit hit;
    if (!rays.intersect(from, glm::normalize(vec3(0.2f * b.x, -b.y, -2.0f)), 0.0f, kInfinity, hit))
      continue;
    const std::uint32_t number = emitters.find(hit);
    ASSERT_NE(number, Emitters::kNotFound);
    const Emitters::Triangle& t = emitters.triangles()[number];
    const vec3 there(t.corner + static_cast<double>(hit.u) * dvec3(t.edge1) +
                     static_cast<double>(hit.v) * dvec3(t.edge2));
    EXPECT_LT(glm::length(there - vec3(rays.surface(hit).position)), 1e-5f);
    ++found;
  }
  EXPECT_GT(found, 100);
}

}  // namespace
}  // namespace trex
