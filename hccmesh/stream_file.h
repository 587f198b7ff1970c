// A file of bytes at offsets. Private to the streaming build.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

namespace hccm {

/// Reads and writes may run at once. All calls throw FileError that names the file.
class StreamFile {
 public:
  enum class Mode { kCreate, kRead, kAppend };
  StreamFile(const std::filesystem::path& path, Mode mode);
  ~StreamFile();
  StreamFile(const StreamFile&) = delete;
  StreamFile& operator=(const StreamFile&) = delete;

  void write(std::uint64_t offset, std::span<const std::byte> bytes);
  void read(std::uint64_t offset, std::span<std::byte> out) const;
  std::uint64_t size() const;

 private:
  std::filesystem::path path_;
  int file_;
};

}  // namespace hccm
