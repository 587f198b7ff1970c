#include "src/viewer/recovery.h"

#include <fmt/format.h>

#include "src/core/file.h"
#include "src/core/hash.h"

namespace trex {
namespace fs = std::filesystem;

fs::path statePath(const fs::path& model, const char* kind) {
  const fs::path folder = stateFolder();
  if (folder.empty()) return {};
  std::error_code problem;
  const std::string absolute = fs::weakly_canonical(model, problem).string();
  return folder / kind / fmt::format("{}-{:016x}.json", model.stem().string(), hashText(absolute));
}

fs::path recoveryPath(const fs::path& model) { return statePath(model, "recovery"); }

}  // namespace trex
