#include "src/viewer/recovery.h"

#include <fmt/format.h>

#include <cstdlib>

#include "src/core/hash.h"

namespace trex {
namespace fs = std::filesystem;

fs::path statePath(const fs::path& model, const char* kind) {
  const char* state = std::getenv("XDG_STATE_HOME");
  const char* home = std::getenv("HOME");
  fs::path folder;
  if (state != nullptr && *state != '\0') {
    folder = state;
  } else if (home != nullptr && *home != '\0') {
    folder = fs::path(home) / ".local" / "state";
  } else {
    return {};
  }
  std::error_code problem;
  const std::string absolute = fs::weakly_canonical(model, problem).string();
  return folder / "trex" / kind /
         fmt::format("{}-{:016x}.json", model.stem().string(), hashText(absolute));
}

fs::path recoveryPath(const fs::path& model) { return statePath(model, "recovery"); }

}  // namespace trex
