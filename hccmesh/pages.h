// Meshes on disk: pages of clusters that are loaded when a ray needs them, under a hard limit.
//
//   table (resident): header | page, page, ... | group, group, ...
//   pages (on disk):  packed clusters of page 0 | of page 1 | ...      see FORMAT.md, "Pages"
//
// A group is up to kGroupClusters clusters that follow each other in one page and lie close
// together. A hierarchy of the caller's choice goes over the groups' bounds; only a ray that meets
// a group's box needs its page.
//
// Cluster numbers of hits are page * kPageClusters + number in the page, so a hit says where it is,
// and on equal t the lower (cluster, triangle) wins as in a Mesh. What is hit does not depend on
// what was in memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "hccmesh/hccmesh.h"
#include "hccmesh/pack.h"

namespace hccm {

inline constexpr std::uint32_t kPageTableVersion = 1;
inline constexpr std::uint32_t kPageClusters = 1024;  ///< at most, a page
inline constexpr std::uint32_t kGroupClusters = 8;    ///< at most, a group
inline constexpr std::uint32_t kMostPages =
    1u << 22;  ///< of one mesh: numbers of clusters have 32 bits

/// One page's entry in the table.
struct PageEntry {
  std::uint64_t offset = 0;    ///< in the pages' section
  std::uint64_t checksum = 0;  ///< XXH3-64 of the packed bytes
  std::uint32_t packedBytes = 0;
  std::uint32_t bytes = 0;  ///< in memory: blobs and tail
  std::uint32_t triangles = 0;
  std::uint32_t clusters = 0;
};
static_assert(sizeof(PageEntry) == 32);

/// Clusters [first, first + count) of a page, and their bounds in mesh space (two cells wider than
/// the vertices).
struct PageGroup {
  float lower[3] = {}, upper[3] = {};
  std::uint32_t page = 0;
  std::uint16_t first = 0, count = 0;
};
static_assert(sizeof(PageGroup) == 32);

/// A page as it leaves the builder. Offset and the groups' page are those of the sink to set.
struct BuiltPage {
  PageEntry entry;
  std::vector<PageGroup> groups;
  std::vector<std::byte> packed;
  Sizes sizes;
};

/// What is known of all pages together.
struct PageTable {
  int stepExponent = -24;
  std::uint64_t triangles = 0, droppedTriangles = 0;
  float lower[3] = {}, upper[3] = {};  ///< of all groups, mesh space
  Sizes sizes;
  std::vector<PageEntry> pages;
  std::vector<PageGroup> groups;

  /// Appends a page behind the last. Throws std::invalid_argument beyond kMostPages.
  void add(const BuiltPage& page);
  std::uint64_t packedBytes() const;  ///< of all pages
  std::uint64_t bytes() const;        ///< of all pages in memory
  std::uint64_t clusters() const;
  std::uint32_t largestPage() const;  ///< bytes in memory

  std::vector<std::byte> toBytes() const;
  /// Takes anything; pages must fill `sectionBytes` without gaps. Throws FormatError.
  static PageTable fromBytes(std::span<const std::byte> bytes, std::uint64_t sectionBytes);
};

/// Bytes of a file that are wanted.
struct FilePart {
  std::uint64_t offset = 0;
  std::span<std::byte> out{};
  std::uint64_t checksum = 0;  ///< XXH3-64 of what is there, as of a page's entry; 0: not known
};

/// What a read takes, as far as is known before there was one; a bandwidth of 0: not known.
struct FileSpeed {
  double latency = 0.0, bandwidth = 0.0;  ///< seconds; bytes a second
};

/// Where the packed pages lie. Thread safe.
class PageFile {
 public:
  virtual ~PageFile() = default;
  /// Fills `out` from an offset in the pages' section. Throws with the file and the place.
  virtual void read(std::uint64_t offset, std::span<std::byte> out) const = 0;
  /// Several parts, as read() of each. What comes may differ from a checksum that is known: whoever
  /// could have it from somewhere else looks.
  virtual void readAll(std::span<const FilePart> parts) const {
    for (const FilePart& part : parts) read(part.offset, part.out);
  }
  /// Parts that readAll() had better be given at once: more than one where each question takes long
  /// to be answered, however little it asks for.
  virtual unsigned partsAtOnce() const { return 1; }
  virtual FileSpeed speed() const { return {}; }
  /// May fetch a range ahead of its use; returns at once.
  virtual void readAhead(std::uint64_t offset, std::uint64_t bytes) const = 0;
  /// "FILE, byte N", for messages.
  virtual std::string place(std::uint64_t offset) const = 0;
};

/// Reads the packed bytes of one page, unchecked. Throws what the file throws.
void readPage(const PageFile& file, const PageTable& table, std::uint32_t page,
              std::vector<std::byte>& packed);
/// Checks what was read against the page's entry. `known`: it has passed before, so the checksum is
/// enough. Throws FormatError that names the place.
ClusterPage unpackPage(const PageFile& file, const PageTable& table, std::uint32_t page,
                       std::span<const std::byte> packed, bool known = false);
/// Both.
ClusterPage loadPage(const PageFile& file, const PageTable& table, std::uint32_t page,
                     bool known = false);

}  // namespace hccm
