#include "src/session/model_editor.h"

#include "src/session/mesh_voxel_source.h"

namespace trex {

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
  return invalid;
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
            return std::make_shared<asvo::Tree>(asvo::Tree::build(*source, voxelBuild(options)));
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
