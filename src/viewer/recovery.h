// Unsaved edits of a model, kept while it is open: what is left after a crash.
#pragma once

#include <filesystem>

namespace trex {

/// The file for a model: in $XDG_STATE_HOME/trex/recovery or ~/.local/state/trex/recovery, named
/// after the model and a hash of its path. Empty if there is no home.
std::filesystem::path recoveryPath(const std::filesystem::path& model);

}  // namespace trex
