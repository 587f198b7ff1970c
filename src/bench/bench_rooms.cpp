#include "src/bench/bench_rooms.h"

#include <numbers>

#include "src/session/session.h"

namespace trex {
namespace {

constexpr int kLeakDepth = 6;
constexpr std::uint32_t kSide = 48;  // pixels

Material matte(float albedo, float emission) {
  Material m;
  m.baseColor = vec4(albedo, albedo, albedo, 1.0f);
  m.metallic = 0.0f;
  m.roughness = 1.0f;
  m.specular = 0.0f;
  m.emission = vec3(emission);
  return m;
}

/// Adds the twelve triangles of a box; fronts look inwards or outwards.
void addBox(Scene& scene, const vec3& lower, const vec3& upper, bool inwards) {
  Mesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    mesh.positions.emplace_back(corner & 1 ? upper.x : lower.x, corner & 2 ? upper.y : lower.y,
                                corner & 4 ? upper.z : lower.z);
  }
  constexpr unsigned kQuads[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                     {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& q : kQuads) {
    for (const int half : {1, 2}) {
      const unsigned b = q[half], c = q[half + 1];
      mesh.triangles.emplace_back(q[0], inwards ? c : b, inwards ? b : c);
    }
  }
  Instance instance;
  instance.mesh = static_cast<int>(scene.meshes.size());
  instance.object = static_cast<int>(scene.instances.size());
  scene.meshes.push_back(std::move(mesh));
  scene.instances.push_back(instance);
}

Camera lookAt(const dvec3& eye, const dvec3& target, float verticalFov) {
  Camera camera;
  camera.eye = eye;
  camera.forward = vec3(glm::normalize(target - eye));
  const vec3 side = glm::normalize(glm::cross(camera.forward, vec3(0.1f, 1.0f, 0.2f)));
  camera.up = glm::cross(side, camera.forward);
  camera.verticalFov = verticalFov;
  return camera;
}

/// Above a ground that fixes the voxels' size.
Scene roomInTheSun(float wall) {
  Scene scene;
  scene.materials = {matte(0.5f, 0.0f)};
  const vec3 lower(-2.0f, 1.0f, -2.0f), upper(2.0f, 3.5f, 2.0f);
  addBox(scene, lower, upper, true);
  addBox(scene, lower - wall, upper + wall, false);
  addBox(scene, vec3(-6.0f, -0.5f, -6.0f), vec3(6.0f, 0.0f, 6.0f), false);
  Light sun;
  sun.type = Light::Type::kDirectional;
  sun.direction = glm::normalize(vec3(-1.0f, -1.4f, -0.6f));
  sun.intensity = vec3(1.0f);
  scene.lights = {sun};
  scene.cameras = {lookAt(dvec3(1.2, 2.1, 1.3), dvec3(-2.0, 2.0, -2.0), 1.5f)};
  return scene;
}

/// Mean radiance of the guess, green.
double meanOf(Scene scene, int depth, GuessKind guess, int device) {
  const Camera camera = scene.cameras.front();
  ModelOptions options;
  options.voxelDepth = depth;
  RenderSettings settings;
  settings.width = settings.height = kSide;
  settings.samples = 64;
  settings.guess = guess;
  settings.device = device;
  Session session(std::make_shared<Model>(makeModel(std::move(scene), options)), camera, settings);
  session.run();
  double sum = 0.0;
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) sum += session.frame().mean(x, y).y;
  }
  return sum / (kSide * kSide);
}

}  // namespace

double leakPercent(double leaves, GuessKind guess, int device) {
  const Model model = makeModel(roomInTheSun(0.1f), {.voxelDepth = kLeakDepth});
  const double leaf = static_cast<double>(model.voxels->info.size) / (1 << kLeakDepth);
  Scene scene = roomInTheSun(static_cast<float>(leaves * leaf));
  return 100.0 * std::numbers::pi * meanOf(std::move(scene), kLeakDepth, guess, device);
}

double furnaceErrorPercent(float albedo, GuessKind guess, int device) {
  Scene scene;
  scene.materials = {matte(albedo, 1.0f - albedo)};
  addBox(scene, vec3(-1.0f), vec3(1.0f), true);
  scene.cameras = {lookAt(dvec3(0.2, 0.1, 0.3), dvec3(1.0, 0.4, -0.2), 1.2f)};
  return 100.0 * (meanOf(std::move(scene), 6, guess, device) - 1.0);
}

}  // namespace trex
