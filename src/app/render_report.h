// What `trex render` tells of a finished picture: the JSON summary and the file's metadata.
#pragma once

#include <nlohmann/json.hpp>

#include "src/command/render_arguments.h"
#include "src/machines/leader.h"
#include "src/session/session.h"

namespace trex {

/// `leader`: of several machines, or null.
nlohmann::json summary(const RenderArguments& a, const View& view, const Session& session,
                       std::uint64_t replacedParts, double importSeconds, float exposure,
                       const machines::Leader* leader = nullptr);

/// Adds version, scene, camera, samples, seed, settings, device and count of non-finite samples as
/// "trex:KEY" attributes. They are the same for equal renders, and by however many machines, if
/// these have the same devices and instruction sets: else all of them are named.
void addMetadata(Picture& picture, const RenderArguments& a, const View& view,
                 const Session& session, const machines::Leader* leader = nullptr);

}  // namespace trex
