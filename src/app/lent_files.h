// Files of machine 0 that other machines read, and their copies there.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "src/bundle/page_disk.h"
#include "src/bundle/page_file.h"
#include "src/core/error.h"
#include "src/machines/page_server.h"
#include "src/machines/worker.h"

namespace trex {

/// A file by its path; empty if there is none.
inline machines::ServedFile servedFile(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  const std::uint64_t size = fs::is_regular_file(path, error) ? fs::file_size(path, error) : 0;
  if (error || size == 0) return {};
  return {std::make_shared<bundle::FilePages>(path, 0), size};
}

/// Packed pages of the model are kept here for other machines, in a file in a folder, unless no
/// other would ask.
inline void passPagesOn(machines::Worker& worker, const machines::Welcome& welcome,
                        const std::filesystem::path& folder, std::uint64_t limit) {
  if (welcome.local || welcome.holder != 0 || worker.machines() < 3) return;
  const int file = openPageDisk(folder, limit, "other machines get no pages from this one");
  if (file >= 0) worker.passOn(std::make_unique<machines::PageShelf>(file, limit), welcome);
}

/// Copies of machine 0's small files, for as long as this is there.
class LentFiles {
 public:
  LentFiles(machines::Worker& worker, const machines::Welcome& welcome)
      : worker_(worker), welcome_(welcome) {}
  ~LentFiles() {
    std::error_code ignored;
    for (const std::filesystem::path& path : paths_) std::filesystem::remove(path, ignored);
  }
  LentFiles(const LentFiles&) = delete;
  LentFiles& operator=(const LentFiles&) = delete;

  bool has(std::uint32_t number) const { return welcome_.fileBytes[number] > 0; }
  /// The path of the copy of a file that is called `name` on machine 0. Throws Error.
  std::string take(std::uint32_t number, const std::string& name) {
    namespace fs = std::filesystem;
    constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
    const std::uint64_t size = welcome_.fileBytes[number];
    if (size > kMost) {
      fail(ExitCode::kInput, "{}: is too large to be sent; use --scene-db local", name);
    }
    std::vector<std::byte> bytes(size);
    worker_.file(number, name)->read(0, bytes);
    const fs::path path =
        fs::temp_directory_path() /
        fmt::format("trex-{}-{}{}", ::getpid(), number, fs::path(name).extension().string());
    paths_.push_back(path);
    std::ofstream out(path, std::ios::binary | std::ios::trunc);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(size));
    out.close();
    if (!out) fail(ExitCode::kOutput, "{}: can't be written", path.string());
    return path.string();
  }

 private:
  machines::Worker& worker_;
  const machines::Welcome& welcome_;
  std::vector<std::filesystem::path> paths_;
};

}  // namespace trex
