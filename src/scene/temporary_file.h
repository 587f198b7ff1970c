// Files without a name, for what does not fit in memory: they go with who opened them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>

#include "src/scene/texel_tiles.h"

namespace trex::detail {

/// Opens a file in a folder, without a name there. Throws Error(kOutput) that names the folder.
int openTemporaryFile(const std::filesystem::path& folder);

/// Packed texels that were put aside. Thread safe but for append().
class TemporaryTexels : public TexelFile {
 public:
  /// Throws Error(kOutput) if no file can be made in the folder.
  explicit TemporaryTexels(std::filesystem::path folder);
  ~TemporaryTexels() override;
  TemporaryTexels(const TemporaryTexels&) = delete;
  TemporaryTexels& operator=(const TemporaryTexels&) = delete;

  /// Returns where the bytes begin. Throws Error(kOutput) if the disk is full.
  std::uint64_t append(std::span<const std::byte> bytes);
  std::uint64_t size() const { return size_; }
  void read(std::uint64_t offset, std::span<std::byte> out) const override;
  void readAhead(std::uint64_t offset, std::uint64_t bytes) const override;
  std::shared_ptr<const std::span<const std::byte>> map(std::uint64_t offset,
                                                        std::uint64_t bytes) const override;
  void bad(std::uint64_t offset, const std::string& what) const override;

 private:
  std::filesystem::path folder_;
  int file_;
  std::uint64_t size_ = 0;
};

}  // namespace trex::detail
