// A small scene with a little of everything that a bundle keeps.
#pragma once

#include <random>

#include "src/bundle/bundle.h"
#include "tests/unit/scenes.h"

namespace trex::test {

inline Image noiseImage(int width, int height, int channels, bool isFloat, unsigned seed) {
  std::mt19937 random(seed);
  Image image;
  image.name = "noise";
  image.width = width, image.height = height, image.channels = channels;
  for (int i = 0; i < width * height * channels; ++i) {
    if (isFloat) image.floats.push_back(static_cast<float>(random() % 1000) / 7.0f);
    if (!isFloat) image.bytes.push_back(static_cast<std::uint8_t>(random()));
  }
  return image;
}

/// Numbers that decimal text does not hold easily: 1/3, a denormal, a negative zero.
inline void addAwkwardNumbers(Scene& scene) {
  Material glass = lambert(1.0f / 3.0f);
  glass.name = "glass \"\xc3\xa4\"\n";
  glass.transmission = 0.1f;
  glass.finish.clearcoat = 1.0f / 3.0f;
  glass.finish.metalEta = vec3(0.2f, 0.9f, 1.1f), glass.finish.metalK = vec3(3.9f, 2.4f, 2.1f);
  glass.finish.beckmann = true;
  glass.finish.sheenColor = vec3(0.1f, 0.2f, 1.0f / 3.0f);
  glass.finish.iridescenceThickest = 0.1f;
  glass.finish.anisotropyTexture.image = 0;
  glass.attenuationDistance = 1e-38f / 3.0f;
  glass.normalScale = -0.0f;
  glass.alphaMode = AlphaMode::kMask;
  scene.materials.push_back(glass);
  Light light;
  light.type = Light::Type::kSpot;
  light.name = "spot";
  light.position = dvec3(1.0 / 3.0, 5e6 + 0.1, -0.0);
  light.intensity = vec3(1e30f, 0.1f, 1e-30f);
  scene.lights.push_back(light);
  light.range = 12.7f;
  scene.lights.push_back(light);
}

inline Scene littleOfEverything() {
  Scene scene;
  scene.source = "folder/little.glb";
  scene.materials = {lambert(0.7f), lambert(0.2f, 5.0f), lambert(0.9f)};
  scene.images = {noiseImage(37, 21, 3, false, 1), noiseImage(8, 16, 4, true, 2)};
  scene.materials[2].baseColorTexture.image = 0;
  scene.materials[2].baseColorTexture.wrapT = Texture::Wrap::kMirror;
  scene.materials[2].emissiveTexture.image = 1;
  scene.materials[2].emissiveTexture.set = 1;
  addAwkwardNumbers(scene);
  for (int i = 0; i < 6; ++i) scene.objects.push_back("object " + std::to_string(i));
  scene.meshes = {box(vec3(-4.0f), vec3(4.0f), 0, true),
                  box(vec3(-1.0f, 3.8f, -1.0f), vec3(1.0f, 3.9f, 1.0f), 1, false),
                  sphere(vec3(0.0f), 1.0f, 2, 24)};
  for (const vec3& p : scene.meshes[2].positions) {
    scene.meshes[2].texCoords.emplace_back(p.x, p.y * 3.0f);
    scene.meshes[2].secondTexCoords.emplace_back(p.z, p.x * 0.3f);
    scene.meshes[2].normals.push_back(glm::normalize(p));
  }
  const auto put = [&](int mesh, const dmat4& transform) {
    Instance instance;
    instance.name = "instance";
    instance.mesh = mesh;
    instance.transform = transform;
    instance.object = static_cast<int>(scene.instances.size());
    scene.instances.push_back(instance);
  };
  put(0, dmat4(1.0));
  put(1, dmat4(1.0));
  for (int i = 0; i < 3; ++i) {
    dmat4 m(1.0);
    m[0][0] = i == 2 ? -0.7 : 0.6 + 0.1 * i;
    m[1][0] = 0.1;
    m[3] = glm::dvec4(2.0 * i - 2.0, -1.0 / 3.0, 0.3 * i, 1.0);
    put(2, m);
  }
  scene.cameras.emplace_back().name = "first";
  scene.cameras.emplace_back().orthographic = true;
  scene.environment.color = vec3(0.3f, 0.2f, 0.1f);
  scene.environment.map = std::make_shared<Image>(noiseImage(16, 8, 3, true, 3));
  scene.warnings = {"folder/little.glb: something \"odd\""};
  scene.droppedTriangles = 7;
  return scene;
}

inline Model littleModel(int depth = 3) {
  ModelOptions options;
  options.voxelDepth = depth;
  options.voxels = depth > 0;
  return makeModel(littleOfEverything(), options);
}

inline BakeFacts littleFacts(int depth = 3) {
  BakeFacts facts;
  facts.input = "folder/little.glb";
  facts.voxelDepth = depth;
  facts.files = {{{"../little.glb", 1234, 1'700'000'000'123'456'789}, 0x0123456789abcdefull}};
  facts.requirements = bundle::requirementsOf(littleOfEverything(), true);
  return facts;
}

/// Reads a buffer that outlives what is read.
inline BundleContents readBuffer(const std::vector<std::byte>& bytes) {
  return readBundle(bytes, nullptr, "x.trex");
}
BundleContents readBuffer(std::vector<std::byte>&&) = delete;

}  // namespace trex::test
