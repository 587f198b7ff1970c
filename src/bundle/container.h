// The file of a bundle: a header, named sections, a directory, and a checksum over every byte.
// FORMAT.md is the authority.
//
//   header 4096 | section | section | ... | directory: entries, hashes of pages
//               each at a multiple of 4096
//
// Trust: takes anything. What is not as FORMAT.md says throws Error(kInput) that names the file,
// the place, and what to do.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace trex::bundle {

inline constexpr std::uint32_t kVersion = 2;
inline constexpr std::uint64_t kAlignment = 4096;       ///< of sections, bytes
inline constexpr std::uint64_t kPageBytes = 64 * 1024;  ///< what one checksum covers

/// Bytes [offset, offset + bytes) of the file.
struct Section {
  std::string name;
  std::uint64_t offset = 0, bytes = 0;
};

/// A file's bytes, seen as sections. Keeps no copy. One thread at a time.
class Container {
 public:
  /// Called before bytes [offset, offset + count) are read, once for each: where they come from
  /// elsewhere, they must be there afterwards. May throw.
  using Fetch = std::function<void(std::uint64_t offset, std::uint64_t count)>;

  /// Checks header and directory. `name` is the file's, for messages. Throws Error(kInput).
  Container(std::span<const std::byte> bytes, std::string name, Fetch fetch = {});

  const std::string& name() const { return name_; }
  std::uint64_t fileBytes() const { return bytes_.size(); }
  /// Of all bytes, by the hashes of them that the file keeps.
  std::uint64_t digest() const { return digest_; }
  const std::vector<Section>& sections() const { return sections_; }
  bool has(std::string_view section) const;
  /// The bytes of a section, after checking the pages they lie on. Throws Error(kInput) if there
  /// is none of that name or a page is damaged.
  std::span<const std::byte> section(std::string_view section) const;
  /// The same, unchecked: for sections whose parts have checksums of their own.
  std::span<const std::byte> uncheckedSection(std::string_view section) const;
  /// Where a section starts in the file. Throws as section().
  std::uint64_t offsetOf(std::string_view section) const;
  /// Checks all pages that were not checked before, and that all padding is zero. Throws
  /// Error(kInput) naming the first bad page and its section.
  void verify() const;
  std::uint64_t pageCount() const { return pageChecked_.size(); }
  std::uint64_t pagesChecked() const;

 private:
  const Section& find(std::string_view section) const;
  void readDirectory(std::uint64_t offset, std::uint32_t count);
  void fetch(std::uint64_t offset, std::uint64_t count) const;
  void fetchPages(std::uint64_t first, std::uint64_t end) const;
  void checkPages(std::uint64_t first, std::uint64_t end) const;
  std::string sectionAt(std::uint64_t offset) const;

  std::span<const std::byte> bytes_;
  std::string name_;
  Fetch fetch_;
  std::vector<Section> sections_;                          ///< ascending and without gaps
  std::map<std::string, std::size_t, std::less<>> index_;  ///< by name
  std::uint64_t digest_ = 0;
  std::uint64_t pagesEnd_ = 0;  ///< where the directory starts
  const std::byte* hashes_ = nullptr;
  mutable std::vector<std::uint8_t> pageChecked_;
};

/// Whether the first bytes are those of a bundle of any version.
bool hasBundleMagic(std::span<const std::byte> bytes);

/// What a section of a file to be written holds. Names: up to 47 of a-z, 0-9, '-' and '.'.
struct SectionData {
  std::string name;
  std::span<const std::byte> bytes;
};

/// Gives the bytes of a file to `sink`, from first to last. Equal sections give equal bytes.
/// Uses the calling oneTBB arena.
void writeContainer(std::span<const SectionData> sections,
                    const std::function<void(std::span<const std::byte>)>& sink);

/// Length of the file that writeContainer() makes.
std::uint64_t containerBytes(std::span<const SectionData> sections);

}  // namespace trex::bundle
