// Writing the file of a bundle from front to back, of any size, in little memory; FORMAT.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "src/bundle/container.h"

namespace trex::bundle {

/// One thread at a time. Throws Error(kOutput) that names the file.
class ContainerStream {
 public:
  /// Starts a new file, or goes on with one whose first section has `keptBytes` bytes already: what
  /// follows them is cut off. `name`: of the file for messages.
  ContainerStream(const std::filesystem::path& path, std::string name,
                  const std::string& firstSection, std::uint64_t keptBytes = 0);
  ~ContainerStream();
  ContainerStream(const ContainerStream&) = delete;
  ContainerStream& operator=(const ContainerStream&) = delete;

  /// Appends to the section under way.
  void write(std::span<const std::byte> bytes);
  /// Ends it and starts another.
  void section(const std::string& name);
  /// Ends the last section and writes directory and header. Returns the sections.
  std::vector<Section> finish();

 private:
  struct Hash;
  void append(std::span<const std::byte> bytes);
  void put(std::uint64_t offset, std::span<const std::byte> bytes);
  void hash(std::span<const std::byte> bytes);
  void rehash(std::uint64_t bytes);
  void endSection();
  [[noreturn]] void failed() const;

  std::string name_;
  int file_ = -1;
  std::uint64_t end_;
  std::vector<Section> sections_;
  std::vector<std::uint64_t> hashes_;  ///< of the pages that are full
  std::unique_ptr<Hash> hash_;         ///< of the page under way
};

}  // namespace trex::bundle
