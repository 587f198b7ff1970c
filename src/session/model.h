// A scene made ready for rays: what sessions render from and `trex bake` keeps.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "asvo/asvo.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"

namespace trex {

/// The compressed meshes and the voxels of a scene. Shared by sessions, read only.
struct Model {
  /// Arrays of meshes are empty, but positions and triangles of those that emit: rays see the
  /// compressed meshes, and the source's arrays would only cost.
  Scene scene;
  std::unique_ptr<RayScene> rays;
  std::shared_ptr<asvo::Tree> voxels;  ///< null where every sample is exact
  double meshSeconds = 0.0, voxelSeconds = 0.0;
};

/// Of a mesh in pages on disk, bytes; all zero for a mesh in memory.
struct PagedSizes {
  std::uint64_t pages = 0;     ///< of all pages in memory
  std::uint64_t disk = 0;      ///< of all pages in their file
  std::uint64_t topLevel = 0;  ///< hierarchy over the pages, about
  std::uint64_t largest = 0;   ///< page
};

/// Disk for pages that were unpacked and do not fit in memory.
struct PageDisk {
  std::filesystem::path folder{};
  std::uint64_t bytes = 0;  ///< of a file without a name there; 0: none
};

struct ModelOptions {
  bool voxels = true;            ///< build them if anything shines
  bool voxelsInTheDark = false;  ///< build them even if nothing does: edits may bring light
  int voxelDepth = 8;            ///< levels below the root; more where nearly all is empty
  std::uint64_t voxelBytes = 0;  ///< limit of their arrays with light; 0: none
  int precisionBits = 24;        ///< grid cells along a mesh's largest extent: 2^bits, 8..24
  std::uint64_t cacheBytes = 0;  ///< limit of pages in memory; 0: all of them
  PageDisk pageDisk = {};
  PagedSizes paged = {};  ///< set by who opens a bundle, before it asks for the others
  /// Likewise: bytes of the bundle's voxels, which are in memory; nothing without a bundle.
  std::optional<std::uint64_t> bakedVoxels = {};
};

/// How voxels of such options are built: at opening, and anew after an edit.
asvo::BuildOptions voxelBuild(const ModelOptions& options);

/// Builds what the scene and the options require. Throws Error. Uses the calling oneTBB arena.
Model makeModel(Scene scene, const ModelOptions& options);

/// The two parts of makeModel(), for those who show the meshes while the voxels are built. The
/// second reads the arrays of `scene`'s meshes, its instances and images, and nothing else that may
/// change meanwhile: materials are those given here.
Model makeMeshes(Scene scene, const ModelOptions& options);
std::shared_ptr<asvo::Tree> makeVoxels(const Scene& scene, const std::vector<Material>& materials,
                                       const dvec3& renderOrigin, const ModelOptions& options);
/// Frees what only building needs of a scene's meshes.
void freeSourceArrays(Scene& scene);

/// Of a tree's arrays.
std::uint64_t bytesOf(const asvo::Tree& tree);

/// Leaves are no finer than the picture can show: 256 along the cube from 200 x 200 pixels on.
int voxelDepthFor(std::uint64_t pixels);

}  // namespace trex
