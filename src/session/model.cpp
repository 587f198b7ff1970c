#include "src/session/model.h"

#include <chrono>

#include "src/scene/import.h"
#include "src/session/voxel_source.h"

namespace trex {
namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <typename T>
void release(std::vector<T>& array) {
  std::vector<T>().swap(array);  // assigning {} would keep the memory
}

void freeSourceArrays(Scene& scene) {
  for (Mesh& mesh : scene.meshes) {
    release(mesh.normals);
    release(mesh.texCoords);
    release(mesh.colors);
    if (scene.materials[static_cast<std::size_t>(mesh.material)].emits()) continue;
    release(mesh.positions);
    release(mesh.triangles);
  }
}

}  // namespace

int voxelDepthFor(std::uint64_t pixels) { return pixels >= 40'000 ? 8 : pixels >= 10'000 ? 7 : 6; }

Model makeModel(Scene scene, const ModelOptions& options) {
  Model model;
  model.scene = std::move(scene);
  double mark = now();
  RayScene::Options meshOptions;
  meshOptions.precisionBits = options.precisionBits;
  model.rays = std::make_unique<RayScene>(model.scene, meshOptions);
  model.meshSeconds = now() - mark;
  mark = now();
  if (options.voxels && hasLight(model.scene)) {
    asvo::BuildOptions build;
    build.depth = options.voxelDepth;
    build.maxBytes = options.voxelBytes;
    const VoxelSource source(model.scene, model.rays->renderOrigin());
    model.voxels = asvo::Tree::build(source, build);
  }
  model.voxelSeconds = now() - mark;
  freeSourceArrays(model.scene);
  return model;
}

}  // namespace trex
