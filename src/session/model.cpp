#include "src/session/model.h"

#include <chrono>

#include "src/core/clock.h"
#include "src/scene/import.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

template <typename T>
void release(std::vector<T>& array) {
  std::vector<T>().swap(array);  // assigning {} would keep the memory
}

}  // namespace

std::uint64_t bytesOf(const asvo::Tree& tree) {
  return tree.nodes.size() * sizeof(asvo::uvec2) + tree.voxels.size() * sizeof(asvo::uvec4) +
         tree.leaves.size() * sizeof(asvo::uvec2);
}

int voxelDepthFor(std::uint64_t pixels) { return pixels >= 40'000 ? 8 : pixels >= 10'000 ? 7 : 6; }

void freeSourceArrays(Scene& scene) {
  for (Mesh& mesh : scene.meshes) {
    release(mesh.normals);
    release(mesh.texCoords);
    release(mesh.secondTexCoords);
    release(mesh.colors);
    if (scene.materials[static_cast<std::size_t>(mesh.material)].emits()) continue;
    release(mesh.positions);
    release(mesh.triangles);
  }
}

Model makeMeshes(Scene scene, const ModelOptions& options) {
  Model model;
  model.scene = std::move(scene);
  const double mark = secondsNow();
  RayScene::Options meshOptions;
  meshOptions.precisionBits = options.precisionBits;
  model.rays = std::make_unique<RayScene>(model.scene, meshOptions);
  model.meshSeconds = secondsNow() - mark;
  return model;
}

asvo::BuildOptions voxelBuild(const ModelOptions& options) {
  asvo::BuildOptions build;
  build.depth = options.voxelDepth;
  build.maxBytes = options.voxelBytes;
  build.deepen = true;
  return build;
}

std::shared_ptr<asvo::Tree> makeVoxels(const Scene& scene, const std::vector<Material>& materials,
                                       const dvec3& renderOrigin, const ModelOptions& options) {
  const VoxelSource source(scene, materials, renderOrigin);
  return std::make_shared<asvo::Tree>(asvo::Tree::build(source, voxelBuild(options)));
}

Model makeModel(Scene scene, const ModelOptions& options) {
  Model model = makeMeshes(std::move(scene), options);
  const double mark = secondsNow();
  if (options.voxels && (options.voxelsInTheDark || hasLight(model.scene))) {
    model.voxels =
        makeVoxels(model.scene, model.scene.materials, model.rays->renderOrigin(), options);
  }
  model.voxelSeconds = secondsNow() - mark;
  freeSourceArrays(model.scene);
  return model;
}

}  // namespace trex
