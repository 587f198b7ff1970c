// Hashes of files, to notice that one has changed. Not for secrets.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace trex {

/// XXH3 (64 bits) of a file's bytes. Throws Error(kInput) if it can't be read.
std::uint64_t hashFile(const std::filesystem::path& path);
/// XXH3 (64 bits) of a text.
std::uint64_t hashText(std::string_view text);

}  // namespace trex
