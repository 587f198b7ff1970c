// Files are written beside their target and renamed, so that a reader never sees half of one.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace trex {

/// Writes a file through `write(temporary path)`, flushes it to disk and renames it to `target`.
/// On any failure the temporary is removed, the old target stays, and Error(kOutput) names the
/// target and the reason. The temporary keeps the extension: ".NAME.PID.tmp.EXT".
void writeAtomically(const std::filesystem::path& target,
                     const std::function<void(const std::filesystem::path&)>& write);

/// The same with this text, byte for byte.
void writeTextAtomically(const std::filesystem::path& target, const std::string& text);

/// Removes temporaries that processes which are gone left of writing `target`. Returns their paths.
std::vector<std::filesystem::path> removeDeadTemporaries(const std::filesystem::path& target);

/// Where files are kept from one run to the next: $XDG_STATE_HOME/trex, or ~/.local/state/trex.
/// Empty if there is no home. May not exist.
std::filesystem::path stateFolder();

/// Throws Error(kOutput) early if `target` can't be written: no such folder, a folder itself, no
/// permission.
void checkWritable(const std::filesystem::path& target);

/// Throws Error(kUsage) if both are one file, which -o `target` would replace while it is read.
void checkIsNotInput(const std::filesystem::path& target, const std::filesystem::path& input);

}  // namespace trex
