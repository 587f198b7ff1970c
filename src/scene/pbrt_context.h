// What the parts of the pbrt reader share.
#pragma once

#include <filesystem>
#include <string>
#include <unordered_set>

#include "src/core/error.h"
#include "src/scene/import.h"
#include "src/scene/pbrt_parameters.h"
#include "src/scene/pbrt_tokens.h"

namespace trex::detail {

/// The scene that is made, and where in the file it is made from.
struct PbrtContext {
  Scene& scene;
  const ImportOptions& options;
  std::filesystem::path folder;  ///< of the scene's first file: names of others start there

  // The directive under way.
  std::string file{};
  std::uint64_t line = 0;
  std::string what{};  ///< such as: Shape "sphere"

  std::string where() const { return file + ":" + std::to_string(line); }

  /// Says in Scene::replaced that something is not shown as it is, with file, line and directive.
  template <typename... Args>
  void replace(fmt::format_string<Args...> format, Args&&... args) {
    scene.replaced.add(utf8Of(oneLine(fmt::format(
        "{}: {}: {}", where(), what, fmt::format(format, std::forward<Args>(args)...)))));
  }

  /// Adds a file that was read to Scene::files, once.
  void note(const std::filesystem::path& path) {
    if (noted.insert(path.string()).second) scene.files.push_back(examineSource(path));
  }
  std::unordered_set<std::string> noted{};

  /// Says what is wrong with parameters after they were looked up.
  void report(const PbrtParameters& parameters) {
    for (const std::string& problem : parameters.problems()) replace("{}", problem);
  }
};

}  // namespace trex::detail
