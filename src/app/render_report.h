// What `trex render` tells of a finished picture: the JSON summary and the file's metadata.
#pragma once

#include <nlohmann/json.hpp>

#include "src/command/render_arguments.h"
#include "src/session/session.h"

namespace trex {

nlohmann::json summary(const RenderArguments& a, const View& view, const Session& session,
                       std::uint64_t replacedParts, double importSeconds, float exposure);

/// Adds version, scene, camera, samples, seed, settings, device and count of non-finite samples as
/// "trex:KEY" attributes. They are the same for equal renders.
void addMetadata(Picture& picture, const RenderArguments& a, const View& view,
                 const Session& session);

}  // namespace trex
