// Voxels of a mesh in pages.
#pragma once

#include <functional>

#include "asvo/stream_build.h"
#include "hccmesh/page_cache.h"
#include "src/scene/scene.h"

namespace trex {

/// Builds the voxels of a paged mesh as Tree::build() would from the scene's triangles, with at
/// most `memoryBytes` for triangles at hand. Throws Error(kInput) for pages that can't be read,
/// std::runtime_error where keepGoing says no.
asvo::Tree buildPagedVoxels(const Scene& scene, const hccm::PagedMesh& mesh,
                            const asvo::BuildOptions& options, std::uint64_t memoryBytes,
                            const std::function<bool(double)>& keepGoing);

}  // namespace trex
