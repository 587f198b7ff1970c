// Hashes of files, to notice that one has changed. Not for secrets.
#pragma once

#include <cstdint>
#include <filesystem>

namespace trex {

/// XXH3 (64 bits) of a file's bytes. Throws Error(kInput) if it can't be read.
std::uint64_t hashFile(const std::filesystem::path& path);

}  // namespace trex
