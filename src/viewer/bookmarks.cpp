#include "src/viewer/bookmarks.h"

#include <fstream>
#include <nlohmann/json.hpp>

#include "src/core/error.h"
#include "src/core/file.h"
#include "src/core/json_object.h"
#include "src/core/log.h"
#include "src/viewer/recovery.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

std::vector<Bookmark> parse(const fs::path& file) {
  std::ifstream in(file);
  const nlohmann::json json = nlohmann::json::parse(in);
  const JsonDocument document{file.string(), ""};
  const JsonObject root(json, document, "");
  root.allow({"trex", "bookmarks"});
  std::vector<Bookmark> bookmarks;
  for (std::size_t i = 0; i < root.array("bookmarks").size(); ++i) {
    const JsonObject entry = root.element("bookmarks", i);
    entry.allow({"name", "camera"});
    bookmarks.push_back({entry.text("name"), entry.text("camera")});
  }
  return bookmarks;
}

}  // namespace

fs::path bookmarksFile(const fs::path& model) { return statePath(model, "views"); }

std::vector<Bookmark> readBookmarks(const fs::path& file) {
  std::error_code ignored;
  if (file.empty() || !fs::exists(file, ignored)) return {};
  try {
    return parse(file);
  } catch (const std::exception& e) {
    logWarning("bookmarks are not read: {}", e.what());
    return {};
  }
}

void writeBookmarks(const fs::path& file, const std::vector<Bookmark>& bookmarks) {
  if (file.empty()) return;
  std::error_code ignored;
  fs::create_directories(file.parent_path(), ignored);
  nlohmann::ordered_json json{{"trex", 1}, {"bookmarks", nlohmann::ordered_json::array()}};
  for (const Bookmark& bookmark : bookmarks) {
    json["bookmarks"].push_back({{"name", bookmark.name}, {"camera", bookmark.camera}});
  }
  writeAtomically(file, [&](const fs::path& temporary) {
    std::ofstream out(temporary);
    out << json.dump(1) << '\n';
    if (!out.flush()) fail(ExitCode::kOutput, "{}: could not be written", file.string());
  });
}

}  // namespace trex
