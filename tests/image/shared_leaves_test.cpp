// Surfaces that share voxels with others on which no cached light is read: mirrors, holes, what is
// unlit. A voxel's light is what comes to all of its faces, so photons count at all of them.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/image/rendered.h"
#include "tests/unit/scenes.h"

namespace trex::test {
namespace {

constexpr int kCoarse = 3;  // leaves of a quarter of a metre in a box of two
constexpr float kAlbedo = 0.5f;

/// Closed walls whose radiance is 1, with a floor of material 1.
Scene furnaceOver(const Material& floor) {
  Scene scene = furnace(kAlbedo);
  scene.materials = {lambert(kAlbedo, 1.0f - kAlbedo), floor};
  Mesh& walls = scene.meshes.front();
  walls.triangles.erase(walls.triangles.begin() + 4, walls.triangles.begin() + 6);
  place(scene, panel(-1.0f, 1.0f, -1.0f, 1, true));
  return scene;
}

/// Of leaves that many floors and walls share.
Rendered pictureOf(const Scene& scene, double exact, GuessKind guess) {
  RenderSettings settings = settingsFor(64, exact, exact > 0.0 ? 256 : 64, 3);
  settings.guess = guess;
  settings.photons = 1u << 19;
  return render(scene, settings, kCoarse);
}

constexpr double kLimit = 0.003;

/// The guess's mean over what it should be.
void expectMean(const Scene& scene, const char* name, double right, double limit = kLimit) {
  for (const GuessKind guess : {GuessKind::kRay, GuessKind::kCone}) {
    const double error = pictureOf(scene, 0.0, guess).total.x / right - 1.0;
    report(fmt::format("{} {}, error", name, guess == GuessKind::kRay ? "ray" : "cone"), error,
           limit);
    EXPECT_NEAR(error, 0.0, limit);
  }
}

/// A mirror shows walls of radiance 1.
TEST(SharedLeaves, WallsOverAMirrorKeepTheirLight) {
  Material mirror = lambert(1.0f);
  mirror.metallic = 1.0f;
  mirror.roughness = 0.0f;
  expectMean(furnaceOver(mirror), "furnace over a mirror", 1.0);
}

/// Two in five rays pass a sheet that emits and reflects as the walls do.
TEST(SharedLeaves, ASheetWithHolesHasTheLightThatComesToIt) {
  Scene scene = furnace(kAlbedo);
  Material sheet = lambert(kAlbedo, 1.0f - kAlbedo);
  sheet.baseColor.w = 0.6f;
  sheet.alphaMode = AlphaMode::kBlend;
  sheet.doubleSided = true;
  scene.materials = {lambert(kAlbedo, 1.0f - kAlbedo), sheet};
  place(scene, panel(-1.0f, 1.0f, -0.4f, 1, true));
  expectMean(scene, "furnace with a sheet of holes", 1.0);
}

/// A floor that takes all light: near it light falls off within a voxel, of which means know less.
/// (What an unlit surface sends others, photons do not bring.)
TEST(SharedLeaves, WallsOverABlackUnlitFloorKeepTheirLight) {
  Material unlit = lambert(0.0f);
  unlit.unlit = true;
  const Scene scene = furnaceOver(unlit);
  const double right = pictureOf(scene, 1.0, GuessKind::kRay).total.x;
  expectMean(scene, "furnace over an unlit floor", right, 0.005);
}

}  // namespace
}  // namespace trex::test
