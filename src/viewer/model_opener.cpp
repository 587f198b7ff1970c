#include "src/viewer/model_opener.h"

#include <algorithm>

#include "hccmesh/page_cache.h"
#include "src/core/memory.h"
#include "src/session/preflight.h"
#include "src/session/session.h"

namespace trex {
namespace {

/// Meshes at once, then voxels built beside them from the source's arrays.
void openSource(const ModelOpening& o, const std::function<void(Background::Delivery)>& deliver) {
  checkSourceFits(o.input, o.settings);
  ImportOptions import = o.options.import;
  import.environmentGiven = o.options.environment.has_value();
  Scene scene = importScene(o.input, import);
  if (o.options.environment) scene.environment = *o.options.environment;
  ModelOptions options = o.options.model;
  options.voxelBytes = preflight(scene, o.settings, {}).voxelBytes;
  auto model = std::make_shared<Model>(makeMeshes(std::move(scene), options));
  // The screen edits its scene; this one keeps the arrays until the voxels are built.
  Scene source = model->scene;
  freeSourceArrays(model->scene);
  const dvec3 origin = model->rays->renderOrigin();
  deliver([take = o.takeMeshes, model, options] { take(model, options); });
  model.reset();
  if (!options.voxels) return;
  auto tree = makeVoxels(source, source.materials, origin, options);
  auto device = std::make_shared<std::unique_ptr<GRayTracer>>(
      makeLightDevice(source.materials, source.images, *tree, o.settings));
  deliver([take = o.takeVoxels, tree, device] { take(tree, device); });
}

/// For pages of a streamed bundle; 0: all of them.
std::uint64_t cacheFor(const ModelOpening& o, const Scene& scene, const ModelOptions& model) {
  if (o.cacheBytes > 0) return o.cacheBytes;
  if (o.settings.maxMemory == 0) return 0;
  const Preflight fit = preflight(scene, o.settings, {}, model.bakedVoxels, model.paged.topLevel);
  return std::max<std::uint64_t>((fit.allowed - fit.needed) / 8 * 7, 1);
}

void openBaked(const ModelOpening& o, const std::function<void(Background::Delivery)>& deliver) {
  OpenOptions open = o.options;
  open.prepare = [&](const Scene& scene, ModelOptions& made) {
    if (made.paged.pages > 0)
      made.cacheBytes = std::min(cacheFor(o, scene, made), made.paged.pages);
  };
  auto model = std::make_shared<Model>(
      o.remote ? openRemoteBundle(o.remote->file, o.remote->bytes, o.input.string(), open)
               : openBundle(o.input, open));
  if (hccm::PagedMesh* pages = model->rays->parts().paged.get(); pages != nullptr && o.remote) {
    pages->fetchBehind();
  }
  const auto tree = std::exchange(model->voxels, nullptr);
  const std::vector<Material> materials = model->scene.materials;
  // Images are not edited, and stay with the model, which is kept until its device is made.
  ModelOptions options = o.options.model;
  options.voxels = tree != nullptr;
  deliver([take = o.takeMeshes, model, options] { take(model, options); });
  if (!tree) return;
  auto device = std::make_shared<std::unique_ptr<GRayTracer>>(
      makeLightDevice(materials, model->scene.images, *tree, o.settings));
  deliver([take = o.takeVoxels, tree, device] { take(tree, device); });
}

}  // namespace

Background::Job openingJob(ModelOpening opening) {
  return [o = std::move(opening)](const std::function<void(Background::Delivery)>& deliver) {
    o.remote || isBundlePath(o.input) ? openBaked(o, deliver) : openSource(o, deliver);
  };
}

}  // namespace trex
