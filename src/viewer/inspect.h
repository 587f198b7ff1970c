// Views of what the renderer works with: what pixels know, voxels, photons.
#pragma once

#include <functional>

#include "src/session/session.h"
#include "src/viewer/viewer.h"

namespace trex {

/// Value in [0, 1] of a pixel in a view that the frame's sums give; depth and variance are scaled
/// by what the lattice of the frame holds.
std::function<vec3(const FrameBuffers&, std::uint32_t, std::uint32_t)> viewOf(
    ViewMode mode, const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
    std::uint32_t spacing);

/// Traces the pixels of one cell of the lattice for kVoxels or kPhotons, and fills the blocks that
/// they stand for until finer cells come.
void inspectCell(const Session& session, const ViewState& state, std::uint32_t cell,
                 std::vector<vec3>& picture);

/// Puts the exact mode's picture right of `at`, a share of the width, and a line between.
void splitWith(const Session& exact, float at, std::vector<vec3>& picture);

}  // namespace trex
