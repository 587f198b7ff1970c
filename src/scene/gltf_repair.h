// glTF: what tinygltf would refuse a whole file for.
#pragma once

#include <functional>
#include <string>

#include "src/scene/gltf_detail.h"

namespace trex::detail {

/// Tries to parse some glTF; returns what is wrong with it, or nothing.
using TryGltf = std::function<std::string(const std::string& json)>;

/// The JSON of a file that was refused, with empty parts instead of those that are refused alone,
/// each told to the context. Empty if it has no asset, or more than 64 MiB.
std::string repairedGltf(GltfContext& context, const std::string& json, const TryGltf& problemOf);

}  // namespace trex::detail
