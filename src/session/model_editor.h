// Edits of a model that is open: one apply() for every class of change. The scene's materials,
// lights and environment, what rays see, and the voxels follow a look; everything depends on the
// look alone and not on the way to it, so that a capture of the same look gives the same pixels.
//
//   apply(look)    at once: scene, visibility, emitters
//   voxels(...)    before photons are shot: values of edited materials
//   rebuild        if the look hides or cuts something, or makes it clear: other voxels, built by
//                  the caller on any thread; until they are taken the old ones serve previews
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "src/scene/look.h"
#include "src/session/model.h"
#include "src/session/voxel_values.h"

namespace trex {

class ModelEditor {
 public:
  /// `options`: those of rebuilding voxels. The model must not change but by this editor.
  ModelEditor(std::shared_ptr<Model> model, const ModelOptions& options);

  const Model& model() const { return *model_; }
  std::shared_ptr<const Model> shared() const { return model_; }
  const Look& source() const { return source_; }  ///< as the file has it
  const Look& look() const { return look_; }

  /// Shows a look with as many materials as the scene has. Takes some ms at most. Not while rays
  /// are traced.
  Invalidation apply(const Look& look);

  /// The model's own voxels have come (built after the meshes).
  void setSourceVoxels(std::shared_ptr<asvo::Tree> tree);
  bool hasSourceVoxels() const { return sourceValues_ != nullptr; }
  /// Whether Model::voxels are of another shape than the look asks for.
  /// Never of a mesh in pages: its voxels keep what is hidden, and cached light with them.
  bool voxelsOutdated() const {
    return hasSourceVoxels() && !model_->rays->parts().paged && !(shapeOf(look_) == shape_);
  }
  /// What decides which voxels there are.
  struct Shape {
    Visibility visibility;
    std::vector<bool> clear;  ///< by material: light passes it
    bool operator==(const Shape&) const = default;
  };
  /// Voxels of a shape, to be built by any thread while apply() may be called. The editor's model
  /// must outlive it.
  struct VoxelJob {
    Shape shape;
    std::function<std::shared_ptr<asvo::Tree>()> build;
  };
  /// The voxels that the look asks for.
  VoxelJob voxelJob() const;
  /// Takes what a job built. False, and nothing, if the look asks for another shape by now.
  bool takeVoxels(std::shared_ptr<asvo::Tree> tree, const Shape& shape);
  /// Brings the values of Model::voxels up to the look's materials. Not while rays are traced.
  void updateVoxelValues();
  /// All of the above at once, for captures.
  void finishVoxels();

 private:
  Shape shapeOf(const Look& look) const;
  std::vector<Material> materialsOf(const Shape& shape) const;

  std::shared_ptr<Model> model_;
  ModelOptions options_;
  Look source_, look_;
  Shape sourceShape_, shape_;
  std::unique_ptr<VoxelValues> sourceValues_, values_;  ///< values_: of a rebuilt tree
};

/// A model under the edits of a file; for captures. Adds what the edits require of it.
void applyLook(const std::shared_ptr<Model>& model, const Look& look, const ModelOptions& options);

}  // namespace trex
