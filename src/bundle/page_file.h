// The pages of a bundle, as the page cache reads them.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "hccmesh/pages.h"
#include "src/core/error.h"
#include "src/scene/texel_tiles.h"

namespace trex::bundle {

/// Pages in a file that is read, not mapped: what is in memory is the cache's business alone.
class FilePages : public hccm::PageFile {
 public:
  /// `start`: of the pages' section in the file. Throws Error(code) that names the file if it can't
  /// be opened; read() if it can't be read.
  FilePages(const std::filesystem::path& path, std::uint64_t start,
            ExitCode code = ExitCode::kInput);
  ~FilePages() override;
  FilePages(const FilePages&) = delete;
  FilePages& operator=(const FilePages&) = delete;
  void read(std::uint64_t offset, std::span<std::byte> out) const override;
  void readAhead(std::uint64_t offset, std::uint64_t bytes) const override;
  std::string place(std::uint64_t offset) const override;

 private:
  std::string name_;
  std::uint64_t start_;
  ExitCode code_;
  int file_;
};

/// Pages in memory, such as those of a file that is mapped.
class MemoryPages : public hccm::PageFile {
 public:
  MemoryPages(std::span<const std::byte> section, std::shared_ptr<const void> owner,
              std::string name, std::uint64_t start)
      : section_(section), owner_(std::move(owner)), name_(std::move(name)), start_(start) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override;
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override;

 private:
  std::span<const std::byte> section_;
  std::shared_ptr<const void> owner_;
  std::string name_;
  std::uint64_t start_;
};

/// The packed texels of a bundle, at offsets in its file.
class BundleTexels : public TexelFile {
 public:
  /// `file`: that reads all of the bundle.
  explicit BundleTexels(std::unique_ptr<const hccm::PageFile> file) : file_(std::move(file)) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    file_->read(offset, out);
  }
  void readAhead(std::uint64_t offset, std::uint64_t bytes) const override {
    file_->readAhead(offset, bytes);
  }
  void bad(std::uint64_t offset, const std::string& what) const override {
    fail(ExitCode::kInput, "{}: {}; bake again", file_->place(offset), what);
  }

 private:
  std::unique_ptr<const hccm::PageFile> file_;
};

/// Pages that start somewhere in another file.
class PagesWithin : public hccm::PageFile {
 public:
  PagesWithin(std::shared_ptr<const hccm::PageFile> file, std::uint64_t start)
      : file_(std::move(file)), start_(start) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    file_->read(start_ + offset, out);
  }
  void readAll(std::span<const hccm::FilePart> parts) const override {
    std::vector<hccm::FilePart> within(parts.begin(), parts.end());
    for (hccm::FilePart& part : within) part.offset += start_;
    file_->readAll(within);
  }
  unsigned partsAtOnce() const override { return file_->partsAtOnce(); }
  hccm::FileSpeed speed() const override { return file_->speed(); }
  void readAhead(std::uint64_t offset, std::uint64_t bytes) const override {
    file_->readAhead(start_ + offset, bytes);
  }
  std::string place(std::uint64_t offset) const override { return file_->place(start_ + offset); }

 private:
  std::shared_ptr<const hccm::PageFile> file_;
  std::uint64_t start_;
};

}  // namespace trex::bundle
