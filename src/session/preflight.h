// What a render will need of memory, against what it may use, before it is allocated.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "src/frame/layers.h"
#include "src/scene/scene.h"
#include "src/session/settings.h"

namespace trex {

/// Bytes by phase of a render, the peak of each; voxels take what the dearest phase leaves.
struct Preflight {
  struct Phase {
    std::string name;
    std::uint64_t bytes;
  };
  std::vector<Phase> phases;
  std::uint64_t needed = 0;      ///< the largest of them, with the fewest voxels that make sense
  std::uint64_t allowed = 0;     ///< `--max-memory`, or what the machine has
  std::uint64_t voxelBytes = 0;  ///< limit of the voxels' arrays with light; 0: none are built
};

/// What images keep to by the settings: null if nothing limits them. Of --max-memory it is half,
/// without what the program itself takes.
/// `folder`: for what does not fit.
std::shared_ptr<TextureCache> textureCacheFor(const RenderSettings& settings,
                                              const std::filesystem::path& folder);

/// Throws Error(kMemoryOrDevice) if a source file alone cannot fit.
void checkSourceFits(const std::filesystem::path& source, const RenderSettings& settings);

/// Estimates from an imported scene, whose own bytes are measured. Logs the table (kVerbose).
/// Throws Error(kMemoryOrDevice), with the table in the log, if it does not fit.
/// `bakedVoxels`: bytes of the voxels of the bundle that the scene is from; nothing if it is
/// imported. The hierarchy of pages on disk takes `topLevelBytes`.
Preflight preflight(const Scene& scene, const RenderSettings& settings, const PictureLayers& layers,
                    std::optional<std::uint64_t> bakedVoxels = {}, std::uint64_t topLevelBytes = 0);

}  // namespace trex
