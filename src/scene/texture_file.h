// Images by the names that OBJ, MTL and PLY files give them.
#pragma once

#include <filesystem>
#include <string>

#include "src/scene/scene.h"

namespace trex::detail {

/// The file that an exporter means by a name, as it was written on another machine: in quotes, with
/// backslashes, with the folder of its author, in another case. Looked for from `folder` on. The
/// path as written if there is no such file.
std::filesystem::path findFile(const std::filesystem::path& folder, std::string name);

/// Index into Scene::images of such a file, decoded once. kNone if it is missing, broken, or of the
/// network; then Scene::replaced tells so, with `where` in front and `instead` at the end.
int imageOfFile(Scene& scene, const std::filesystem::path& folder, const std::string& name,
                bool srgb, const std::string& where, const std::string& instead);

}  // namespace trex::detail
