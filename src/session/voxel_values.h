// What voxels keep of materials, brought up to date after an edit without building them again.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "asvo/asvo.h"
#include "src/scene/scene.h"

namespace trex {

/// Voxels of one tree whose albedo follows edited materials. A voxel follows the
/// material that covers most of it, so where several meet the result is an approximation; it
/// depends on the tree and the materials alone, never on the edits before.
class VoxelValues {
 public:
  /// `materials`: those the tree was built with. The tree is edited in place.
  VoxelValues(std::shared_ptr<asvo::Tree> tree, std::vector<Material> materials);

  const std::shared_ptr<asvo::Tree>& tree() const { return tree_; }
  /// Gives the voxels the values of these materials. Not while rays are traced.
  void update(const std::vector<Material>& materials, const std::vector<Image>& images);

 private:
  void index();
  void put(std::uint32_t material, const Material& now, const std::vector<Image>& images);

  std::shared_ptr<asvo::Tree> tree_;
  std::vector<Material> built_, shown_;
  std::vector<asvo::uvec4> source_;            ///< as built; kept from the first edit on
  std::vector<std::uint32_t> order_, firsts_;  ///< voxels by dominant material
};

}  // namespace trex
