// A read-only map of a whole file, for readers that never hold it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace trex::detail {

class MappedFile {
 public:
  /// Throws Error(kInput) if it can't be mapped.
  explicit MappedFile(const std::filesystem::path& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  const std::uint8_t* data() const { return data_; }
  std::size_t size() const { return size_; }
  /// Takes what was read so far out of this process; it comes back when it is read again. Thread
  /// safe.
  void forget() const;

 private:
  const std::uint8_t* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace trex::detail
