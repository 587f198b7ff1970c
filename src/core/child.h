// Processes that read hostile files for this one: what they may take, and what they hand over.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

namespace trex {

/// A file without a name, in memory, for what another process hands over.
class MemoryFile {
 public:
  /// Throws Error(kMemoryOrDevice).
  MemoryFile();
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  int descriptor() const { return file_; }
  /// What was written. Throws Error(kMemoryOrDevice).
  std::shared_ptr<const std::span<const std::byte>> map() const;

 private:
  int file_;
};

/// Where a program or library lies that is built beside this program.
std::filesystem::path besideProgram(const std::string& name);

/// In a child, before it reads: signals do as they do by default, nothing is said on stderr, no
/// core is left, and it ends with its parent. Calls nothing that is unsafe after fork().
void becomeReader();

/// Limits this process, bytes or seconds of the processor (RLIMIT_...). Safe after fork().
void limitProcess(int what, std::uint64_t value);

/// Seconds of the processor that reading a file may take.
std::uint64_t readingSeconds(std::uint64_t fileBytes);

/// Waits for a child to end; its status, as of waitpid().
int waitForChild(int child);

/// One line of plain characters of what a child wrote as a text: names in it come from the file.
std::string textOf(std::span<const std::byte> bytes);

}  // namespace trex
