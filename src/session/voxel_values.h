// What voxels keep of materials, brought up to date after an edit without building them again.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "asvo/asvo.h"
#include "src/scene/scene.h"

namespace trex {

/// Voxels of one tree whose albedo and emission follow edited materials. A voxel follows the
/// material that covers most of it, so where several meet the result is an approximation; it
/// depends on the tree and the materials alone, never on the edits before.
class VoxelValues {
 public:
  /// `materials`: those the tree was built with.
  VoxelValues(std::shared_ptr<const asvo::Tree> tree, std::vector<Material> materials);

  /// The tree with the values of these materials: the one it was made of while none differs. Valid
  /// until the next call, which may change it in place: not while rays are traced.
  std::shared_ptr<const asvo::Tree> with(const std::vector<Material>& materials,
                                         const std::vector<Image>& images);

 private:
  void index();
  void put(std::uint32_t material, const Material& now, const std::vector<Image>& images);

  std::shared_ptr<const asvo::Tree> source_;
  std::vector<Material> built_, shown_;
  std::shared_ptr<asvo::Tree> edited_;         ///< made by the first edit
  std::vector<std::uint32_t> order_, firsts_;  ///< voxels by dominant material
};

}  // namespace trex
