// From a scene's meshes to HCCMeshes and their placements.
#include "src/crays/ray_scene_parts.h"

#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "src/core/error.h"
#include "src/core/log.h"
#include "src/crays/ray_scene_surface.h"

namespace trex {
namespace {

// Only what the scene uses is stored.
hccm::Part partOf(const Scene& scene, const Mesh& mesh) {
  hccm::Part part;
  part.positions = mesh.positions;
  part.triangles = mesh.triangles;
  part.normals = mesh.normals;
  part.colors = mesh.colors;
  if (usesTextures(scene.materials[static_cast<std::size_t>(mesh.material)]))
    part.texCoords = mesh.texCoords;
  part.material = static_cast<std::uint32_t>(mesh.material);
  return part;
}

dmat4 translation(const dvec3& v) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(v, 1.0);
  return m;
}

bool isFinite(const dmat4& m) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!std::isfinite(m[c][r])) return false;
  return true;
}

class PartsBuilder {
 public:
  PartsBuilder(const Scene& scene, const RayScene::Options& options)
      : scene_(scene), options_(options) {
    const Box3d box = scene.bounds();
    if (!box.empty()) renderOrigin_ = box.centre();
  }
  RayScene::Parts build();

 private:
  void addToWorld(const Instance& instance);
  void addShared(std::span<const int> placements);

  const Scene& scene_;
  const RayScene::Options& options_;
  dvec3 renderOrigin_{0.0};
  std::vector<hccm::Part> worldParts_;
  std::vector<hccm::Mesh> shared_;
  std::vector<RayScene::Parts::Placed> placed_;
};

void PartsBuilder::addToWorld(const Instance& instance) {
  const Mesh& mesh = scene_.meshes[static_cast<std::size_t>(instance.mesh)];
  hccm::Part part = partOf(scene_, mesh);
  part.object = static_cast<std::uint32_t>(instance.object);
  part.transform = translation(-renderOrigin_) * instance.transform * translation(mesh.origin);
  if (isFinite(part.transform))
    worldParts_.push_back(part);
  else
    logWarning("instance '{}' has a transform that is not finite; it is left out", instance.name);
}

void PartsBuilder::addShared(std::span<const int> placements) {
  const auto instanceOf = [&](int i) -> const Instance& {
    return scene_.instances[static_cast<std::size_t>(i)];
  };
  const hccm::Part part =
      partOf(scene_, scene_.meshes[static_cast<std::size_t>(instanceOf(placements[0]).mesh)]);
  hccm::BuildOptions build;
  build.precisionBits = options_.precisionBits;
  hccm::Mesh mesh = hccm::Mesh::build({&part, 1}, build);
  if (mesh.triangleCount() == 0) return;
  bool used = false;
  for (int i : placements) {
    const Instance& instance = instanceOf(i);
    Placement placement;
    if (Placement::make(sharedToRender(scene_, instance, mesh, renderOrigin_), mesh.step(),
                        instance.object, placement)) {
      placed_.push_back(
          {static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(shared_.size())});
      used = true;
    } else {
      addToWorld(instance);  // flat: rays have no way into it, its triangles do
    }
  }
  if (used) shared_.push_back(std::move(mesh));
}

RayScene::Parts PartsBuilder::build() {
  std::vector<std::vector<int>> placements(scene_.meshes.size());
  for (std::size_t i = 0; i < scene_.instances.size(); ++i)
    placements[static_cast<std::size_t>(scene_.instances[i].mesh)].push_back(static_cast<int>(i));
  for (std::size_t m = 0; m < placements.size(); ++m) {
    const std::vector<int>& list = placements[m];
    const std::uint64_t triangles = scene_.meshes[m].triangles.size();
    if (list.empty() || triangles == 0) continue;
    if (list.size() == 1 || triangles * list.size() <= options_.mergeTriangles)
      for (int i : list) addToWorld(scene_.instances[static_cast<std::size_t>(i)]);
    else
      addShared(list);
  }
  hccm::BuildOptions worldOptions;
  worldOptions.precisionBits = options_.precisionBits;
  worldOptions.chooseOrigin = false;  // parts come in render space
  return {renderOrigin_, hccm::Mesh::build(worldParts_, worldOptions), std::move(shared_),
          std::move(placed_), nullptr};
}

}  // namespace

bool usesTextures(const Material& m) {
  for (const Texture* t :
       {&m.baseColorTexture, &m.metallicRoughnessTexture, &m.normalTexture, &m.emissiveTexture,
        &m.transmissionTexture, &m.specularTexture, &m.specularColorTexture})
    if (t->present()) return true;
  return false;
}

dmat4 sharedToRender(const Scene& scene, const Instance& instance, const hccm::Mesh& mesh,
                     const dvec3& renderOrigin) {
  const dvec3 origin = scene.meshes[static_cast<std::size_t>(instance.mesh)].origin;
  return translation(-renderOrigin) * instance.transform * translation(origin + mesh.gridOrigin());
}

RayScene::Parts RayScene::makeParts(const Scene& scene, const Options& options) {
  try {
    return PartsBuilder(scene, options).build();
  } catch (const std::invalid_argument& e) {
    fail(ExitCode::kInput, "{}: {}", scene.source, e.what());
  }
}

}  // namespace trex
