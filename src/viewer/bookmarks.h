// Views that a person keeps of a model, from one run to the next.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace trex {

struct Bookmark {
  std::string name;
  std::string camera;  ///< EYE/TARGET/UP/VFOV
  bool operator==(const Bookmark&) const = default;
};

/// Where the bookmarks of a model are kept; empty if there is no place.
std::filesystem::path bookmarksFile(const std::filesystem::path& model);

/// None if there is no such file or it can't be read, which is said in the log.
std::vector<Bookmark> readBookmarks(const std::filesystem::path& file);
/// Writes them, folders included. Throws Error(kOutput).
void writeBookmarks(const std::filesystem::path& file, const std::vector<Bookmark>& bookmarks);

}  // namespace trex
