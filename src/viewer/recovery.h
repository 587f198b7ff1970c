// Files that the viewer keeps for a model from one run to the next: unsaved edits, bookmarks.
#pragma once

#include <filesystem>

namespace trex {

/// A file for a model: in `kind` below $XDG_STATE_HOME/trex or ~/.local/state/trex, named after the
/// model and a hash of its path. Empty if there is no home.
std::filesystem::path statePath(const std::filesystem::path& model, const char* kind);

/// Unsaved edits of a model, kept while it is open: what is left after a crash.
std::filesystem::path recoveryPath(const std::filesystem::path& model);

}  // namespace trex
