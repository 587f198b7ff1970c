// Pictures without background: the layer A and what it multiplies.
#include <gtest/gtest.h>

#include "asvo/medium.h"
#include "src/session/session.h"
#include "tests/unit/scenes.h"

namespace trex {
namespace {

constexpr std::uint32_t kSide = 24;
constexpr float kHalf = 0.4f, kDistance = 3.0f, kFov = 0.5f;

/// A square before the camera, in a sky of 5 that shall not be seen.
Scene plate(const Material& material) {
  Scene scene;
  scene.materials = {material};
  Mesh mesh;
  mesh.positions = {{-kHalf, -kHalf, 0}, {kHalf, -kHalf, 0}, {kHalf, kHalf, 0}, {-kHalf, kHalf, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  test::place(scene, mesh);
  scene.environment.color = vec3(5.0f);
  Camera camera;
  camera.eye = dvec3(0.0, 0.0, kDistance);
  camera.verticalFov = kFov;
  scene.cameras = {camera};
  return scene;
}

Picture render(const Scene& scene, double exact, std::uint32_t samples, bool denoise = true) {
  const auto model = std::make_shared<const Model>(
      makeModel(Scene(scene), {.voxels = exact < 1.0, .voxelDepth = 5}));
  RenderSettings s;
  s.width = s.height = kSide;
  s.samples = samples;
  s.exact = exact;
  s.device = RenderSettings::kNoDevice;
  s.denoise = denoise && exact < 1.0 ? Denoise::kFilter : Denoise::kOff;
  s.transparent = true;
  Session session(model, scene.cameras.front(), s);
  session.run();
  Picture picture = session.picture();
  EXPECT_TRUE(picture.premultiplied);
  EXPECT_EQ(picture.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
  return picture;
}

double mean(const Picture& picture, std::size_t channel) {
  double sum = 0.0;
  for (std::size_t i = channel; i < picture.values.size(); i += 4) sum += picture.values[i];
  return 4.0 * sum / static_cast<double>(picture.values.size());
}

const float* at(const Picture& picture, std::uint32_t x, std::uint32_t y) {
  return &picture.values[4 * (std::size_t{y} * kSide + x)];
}

/// Share of the picture that the square covers.
double coveredShare() {
  const double side = kHalf / (kDistance * std::tan(0.5 * kFov));
  return side * side;
}

/// A square that is 1 everywhere has the colour A in every pixel, edges included, with the filter
/// and without: no fringes.
TEST(Alpha, EdgesOfAnEvenSquareFitInEveryMode) {
  Material unlit;
  unlit.unlit = true;
  for (const double exact : {0.0, 0.25, 1.0}) {
    for (const bool denoise : {true, false}) {
      const Picture picture = render(plate(unlit), exact, 64, denoise);
      EXPECT_NEAR(mean(picture, 3), coveredShare(), 0.01 * coveredShare()) << exact;
      int edges = 0;
      for (std::uint32_t i = 0; i < kSide * kSide; ++i) {
        const float* p = &picture.values[4 * i];
        edges += p[3] > 0.0f && p[3] < 1.0f;
        EXPECT_NEAR(p[1], p[3], 1e-5f) << exact << denoise << " pixel " << i;
      }
      EXPECT_GT(edges, 20);
    }
  }
}

/// A white square in a sky of 5 sends out 5 where it is, and the sky still lights it.
TEST(Alpha, TheEnvironmentLightsButIsNotSeen) {
  for (const double exact : {0.0, 1.0}) {
    const Picture picture = render(plate(test::lambert(1.0f)), exact, 256);
    EXPECT_NEAR(mean(picture, 0) / mean(picture, 3), 5.0, exact < 1.0 ? 0.25 : 0.05) << exact;
    EXPECT_EQ(at(picture, 0, 0)[0], 0.0f);
    EXPECT_EQ(at(picture, 0, 0)[3], 0.0f);
  }
}

TEST(Alpha, BlendedSurfacesCountByTheirAlphaGlassAndMirrorsWhole) {
  Material blended = test::lambert(0.5f);
  blended.alphaMode = AlphaMode::kBlend;
  blended.baseColor.w = 0.3f;
  EXPECT_NEAR(mean(render(plate(blended), 1.0, 1024), 3), 0.3 * coveredShare(),
              0.01 * coveredShare());
  Material glass;
  glass.metallic = 0.0f;
  glass.roughness = 0.0f;
  glass.transmission = 1.0f;
  Material mirror;
  mirror.roughness = 0.0f;
  for (const Material& clear : {glass, mirror}) {
    const Picture picture = render(plate(clear), 1.0, 64);
    EXPECT_EQ(at(picture, kSide / 2, kSide / 2)[3], 1.0f);
    EXPECT_NEAR(at(picture, kSide / 2, kSide / 2)[0], 5.0f,
                0.01f);  // of what is behind or before it
  }
}

/// Fog of optical depth 1.5 before nothing, which a square beside it does not change.
TEST(Alpha, MediaCountByTheirOpacity) {
  std::vector<asvo::MediumLeaf> leaves(8);
  for (int i = 0; i < 8; ++i) {
    leaves[i].origin = 8 * glm::ivec3(i >> 2, i >> 1 & 1, i & 1);
    leaves[i].density = 1.0f;
  }
  Scene scene = plate(test::lambert(0.0f));
  scene.meshes[0].positions = {{90, 0, -99}, {91, 0, -99}, {90, 1, -99}, {91, 1, -99}};  // unseen
  Medium& fog = scene.media.emplace_back();
  fog.grid = std::make_shared<const asvo::Medium>(asvo::Medium::build(leaves));
  fog.albedo = vec3(0.0f);
  fog.density = 1.5f / 2.0f;
  for (int axis = 0; axis < 3; ++axis) fog.transform[axis][axis] = 0.125;
  fog.transform[3] = glm::dvec4(dvec3(-0.9375), 1.0);  // over [-1, 1]^3
  const Picture picture = render(scene, 1.0, 16);
  const float* centre = at(picture, kSide / 2, kSide / 2);
  EXPECT_NEAR(centre[3], 1.0f - std::exp(-1.5f), 2e-3f);
  EXPECT_EQ(centre[0], 0.0f);  // black fog that sends out nothing itself
}

}  // namespace
}  // namespace trex
