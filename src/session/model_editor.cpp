#include "src/session/model_editor.h"

#include "src/crays/ray_scene_parts.h"
#include "src/session/mesh_voxel_source.h"

namespace trex {
namespace {

/// Indices of a cluster's triangles, as in hits.
std::vector<std::uint32_t> trianglesOf(const hccm::Mesh& mesh, std::uint32_t cluster) {
  std::vector<std::uint32_t> out;
  for (std::uint32_t leaf = 0; leaf < mesh.clusterLeafCount(cluster); ++leaf) {
    for (std::uint32_t i = 0; i < mesh.leafTriangleCount(cluster, leaf); ++i) {
      out.push_back(8 * leaf + i);
    }
  }
  return out;
}

/// Meshes whose arrays an edited emission needs again, decoded from the compressed ones: one for
/// each object of the merged mesh, in render space, and each placement of the others.
class EmitterDecoder {
 public:
  EmitterDecoder(const Model& model, std::uint32_t material)
      : model_(model), material_(material), origin_(model.rays->renderOrigin()) {}

  std::vector<Scene::AddedEmitter> run() {
    const RayScene::Parts& parts = model_.rays->parts();
    dmat4 world(1.0);
    world[3] = glm::dvec4(parts.world.gridOrigin(), 1.0);
    for (std::uint32_t c = 0; c < parts.world.clusterCount(); ++c) {
      if (parts.world.clusterMaterial(c) == material_) {
        add(parts.world, c, world, parts.world.clusterObject(c));
      }
    }
    for (const RayScene::Parts::Placed& p : parts.placed) {
      const hccm::Mesh& mesh = parts.shared[p.mesh];
      const SharedPlace place = placeOf(model_.scene, parts, p);
      for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
        if (mesh.clusterMaterial(c) == material_) {
          add(mesh, c, place.toRender,
              place.object == kNone ? mesh.clusterObject(c)
                                    : static_cast<std::uint32_t>(place.object));
        }
      }
    }
    std::vector<Scene::AddedEmitter> out;
    for (auto& [object, mesh] : byObject_) {
      out.push_back({std::move(mesh), static_cast<int>(object)});
    }
    return out;
  }

 private:
  void add(const hccm::Mesh& source, std::uint32_t cluster, const dmat4& toRender,
           std::uint32_t object) {
    Mesh& mesh = byObject_[object];
    mesh.origin = origin_;
    mesh.material = static_cast<int>(material_);
    const bool mirrored = glm::determinant(glm::dmat3(toRender)) < 0.0;
    for (const std::uint32_t t : trianglesOf(source, cluster)) {
      const hccm::Triangle triangle = source.triangle(cluster, t);
      const auto first = static_cast<std::uint32_t>(mesh.positions.size());
      for (const vec3& p : triangle.position) {
        mesh.positions.emplace_back(toRender * glm::dvec4(dvec3(p), 1.0));
      }
      mesh.triangles.emplace_back(first, first + (mirrored ? 2 : 1), first + (mirrored ? 1 : 2));
    }
  }

  const Model& model_;
  std::uint32_t material_;
  dvec3 origin_;
  std::map<std::uint32_t, Mesh> byObject_;
};

}  // namespace

ModelEditor::ModelEditor(std::shared_ptr<Model> model, const ModelOptions& options)
    : model_(std::move(model)),
      options_(options),
      source_(lookOf(model_->scene)),
      look_(source_),
      sourceShape_(shapeOf(source_)),
      shape_(sourceShape_) {
  if (model_->voxels) setSourceVoxels(model_->voxels);
}

ModelEditor::Shape ModelEditor::shapeOf(const Look& look) const {
  Shape shape{Visibility(look, model_->scene.objects.size(), model_->rays->renderOrigin()), {}};
  for (const Material& m : look.materials) shape.clear.push_back(passesLight(m));
  return shape;
}

Invalidation ModelEditor::apply(const Look& look) {
  const Invalidation invalid = invalidatedBy(look_, look);
  look_ = look;
  Scene& scene = model_->scene;
  scene.materials = look.materials;
  scene.lights = look.lights;
  scene.environment = look.environment;
  if (invalid.voxelShape) {
    model_->rays->setVisibility(
        Visibility(look, scene.objects.size(), model_->rays->renderOrigin()));
  }
  if (invalid.lights) showEmitters();
  return invalid;
}

/// Materials that shine by an edit need the triangles that were freed.
void ModelEditor::showEmitters() {
  Scene& scene = model_->scene;
  scene.addedEmitters.clear();
  for (std::uint32_t m = 0; m < scene.materials.size(); ++m) {
    if (source_.materials[m].emits() || !scene.materials[m].emits()) continue;
    const auto& found = emittersOf(m);
    scene.addedEmitters.insert(scene.addedEmitters.end(), found.begin(), found.end());
  }
}

const std::vector<Scene::AddedEmitter>& ModelEditor::emittersOf(std::uint32_t material) {
  const auto found = emitters_.find(material);
  if (found != emitters_.end()) return found->second;
  return emitters_[material] = EmitterDecoder(*model_, material).run();
}

void ModelEditor::setSourceVoxels(std::shared_ptr<asvo::Tree> tree) {
  model_->voxels = tree;
  shape_ = sourceShape_;
  values_.reset();
  sourceValues_ = std::make_unique<VoxelValues>(std::move(tree), source_.materials);
}

/// The file's materials, made clear or opaque as the shape has them: what its voxels are built
/// with, whatever else was edited by then.
std::vector<Material> ModelEditor::materialsOf(const Shape& shape) const {
  std::vector<Material> materials = source_.materials;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    Material& m = materials[i];
    if (passesLight(m) == shape.clear[i]) continue;
    m.transmission = shape.clear[i] ? 1.0f : 0.0f;
    m.metallic = shape.clear[i] ? 0.0f : m.metallic;
    m.roughness = shape.clear[i] ? 0.0f : m.roughness;
    m.alphaMode = AlphaMode::kOpaque;
  }
  return materials;
}

ModelEditor::VoxelJob ModelEditor::voxelJob() const {
  Shape shape = shapeOf(look_);
  if (shape == sourceShape_)
    return {std::move(shape), [tree = sourceValues_->tree()] { return tree; }};
  const auto source = std::make_shared<const MeshVoxelSource>(*model_->rays, model_->scene,
                                                              materialsOf(shape), shape.visibility);
  return {std::move(shape), [source, options = options_] {
            asvo::BuildOptions build;
            build.depth = options.voxelDepth;
            build.maxBytes = options.voxelBytes;
            return std::make_shared<asvo::Tree>(asvo::Tree::build(*source, build));
          }};
}

bool ModelEditor::takeVoxels(std::shared_ptr<asvo::Tree> tree, const Shape& shape) {
  if (!(shape == shapeOf(look_))) return false;
  shape_ = shape;
  model_->voxels = tree;
  values_.reset();
  if (tree != sourceValues_->tree()) {
    values_ = std::make_unique<VoxelValues>(std::move(tree), materialsOf(shape));
  }
  return true;
}

void ModelEditor::updateVoxelValues() {
  VoxelValues* values = values_ ? values_.get() : sourceValues_.get();
  if (values) values->update(look_.materials, model_->scene.images);
}

void ModelEditor::finishVoxels() {
  if (voxelsOutdated()) {
    const VoxelJob job = voxelJob();
    takeVoxels(job.build(), job.shape);
  }
  updateVoxelValues();
}

void applyLook(const std::shared_ptr<Model>& model, const Look& look, const ModelOptions& options) {
  ModelEditor editor(model, options);
  editor.apply(look);
  editor.finishVoxels();
}

}  // namespace trex
