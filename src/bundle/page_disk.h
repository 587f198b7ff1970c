// Disk for pages that were unpacked, or are kept for others: files without a name, in a folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include "hccmesh/unpacked_pages.h"

namespace trex {

/// Bytes that may be taken there without anybody missing them: half of what is free; 0 in a folder
/// that lies in memory or can't be asked.
std::uint64_t spareDisk(const std::filesystem::path& folder);

/// A file there that is open for reading and writing; -1 if none can be made, which a warning says,
/// with what happens instead, or `limit` is 0.
int openPageDisk(const std::filesystem::path& folder, std::uint64_t limit, const char* instead);

/// Null if no file can be made there, or `limit` is 0.
std::unique_ptr<hccm::UnpackedPages> openUnpackedPages(const std::filesystem::path& folder,
                                                       std::uint64_t limit, std::size_t pages);

}  // namespace trex
