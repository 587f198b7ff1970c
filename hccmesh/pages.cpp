#include "hccmesh/pages.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "hccmesh/layout.h"

namespace hccm {
namespace {

struct TableHeader {
  char magic[8];
  std::uint32_t version;
  std::int32_t stepExponent;
  std::uint64_t checksum;  ///< XXH3-64 of the table with this field zero
  std::uint64_t pages, groups, triangles, droppedTriangles;
  std::uint64_t sizes[10];
  float lower[3], upper[3];
};
static_assert(sizeof(TableHeader) == 160 && offsetof(TableHeader, checksum) == 16 &&
              offsetof(TableHeader, sizes) == 56 && offsetof(TableHeader, lower) == 136);

constexpr char kTableMagic[8] = {'H', 'C', 'C', 'p', 'a', 'g', 'e', 's'};

void check(bool good, const char* what, std::uint64_t at) {
  if (!good)
    throw FormatError(std::string("not a valid page table: ") + what + " at byte " +
                      std::to_string(at));
}

template <typename Function>
void forSizes(Sizes& s, const Function& f) {
  std::uint64_t* const fields[10] = {&s.header,   &s.clusterTable, &s.clusterHeaders, &s.vertices,
                                     &s.topology, &s.nodes,        &s.normals,        &s.texCoords,
                                     &s.colors,   &s.padding};
  for (int i = 0; i < 10; ++i) f(i, *fields[i]);
}

std::uint64_t checksumOfTable(std::span<const std::byte> bytes) {
  TableHeader h;
  std::memcpy(&h, bytes.data(), sizeof(h));
  h.checksum = 0;
  const std::uint64_t seed = XXH3_64bits(&h, sizeof(h));
  return XXH3_64bits_withSeed(bytes.data() + sizeof(h), bytes.size() - sizeof(h), seed);
}

void checkPages(const PageTable& table, std::uint64_t sectionBytes) {
  std::uint64_t next = 0, triangles = 0;
  for (std::size_t i = 0; i < table.pages.size(); ++i) {
    const PageEntry& p = table.pages[i];
    const std::uint64_t at = sizeof(TableHeader) + i * sizeof(PageEntry);
    check(p.offset == next && p.packedBytes <= sectionBytes - next, "page misplaced", at);
    check(p.packedBytes > 0 && p.bytes >= layout::kTailBytes &&
              p.bytes <= kMaxPageBytes + layout::kTailBytes,
          "page of wrong size", at);
    check(p.clusters >= 1 && p.clusters <= kPageClusters && p.triangles >= p.clusters &&
              p.triangles <= p.clusters * layout::kMaxTriangles,
          "wrong counts of a page", at);
    next += p.packedBytes;
    triangles += p.triangles;
  }
  check(next == sectionBytes, "pages do not fill their section", 0);
  check(triangles == table.triangles, "wrong triangle count", 40);
}

void checkGroups(const PageTable& table) {
  std::uint32_t page = 0, cluster = 0;
  for (std::size_t i = 0; i < table.groups.size(); ++i) {
    const PageGroup& g = table.groups[i];
    const std::uint64_t at =
        sizeof(TableHeader) + table.pages.size() * sizeof(PageEntry) + i * sizeof(PageGroup);
    check(page < table.pages.size() && g.page == page && g.first == cluster, "groups out of order",
          at);
    check(g.count >= 1 && g.count <= kGroupClusters &&
              cluster + g.count <= table.pages[page].clusters,
          "group of wrong size", at);
    for (int k = 0; k < 3; ++k)
      check(
          g.lower[k] <= g.upper[k] && table.lower[k] <= g.lower[k] && g.upper[k] <= table.upper[k],
          "wrong bounds of a group", at);
    cluster += g.count;
    if (cluster == table.pages[page].clusters) ++page, cluster = 0;
  }
  check(page == table.pages.size(), "clusters without a group", 0);
}

}  // namespace

void PageTable::add(const BuiltPage& page) {
  if (pages.size() >= kMostPages) throw std::invalid_argument("hccm: more than 2^22 pages");
  const bool first = pages.empty();
  PageEntry entry = page.entry;
  entry.offset = first ? 0 : pages.back().offset + pages.back().packedBytes;
  for (PageGroup g : page.groups) {
    g.page = static_cast<std::uint32_t>(pages.size());
    for (int k = 0; k < 3; ++k) {
      const bool unset = groups.empty();
      lower[k] = unset ? g.lower[k] : std::min(lower[k], g.lower[k]);
      upper[k] = unset ? g.upper[k] : std::max(upper[k], g.upper[k]);
    }
    groups.push_back(g);
  }
  pages.push_back(entry);
  triangles += entry.triangles;
  sizes += page.sizes;
}

std::uint64_t PageTable::packedBytes() const {
  return pages.empty() ? 0 : pages.back().offset + pages.back().packedBytes;
}
std::uint64_t PageTable::bytes() const {
  std::uint64_t sum = 0;
  for (const PageEntry& p : pages) sum += p.bytes;
  return sum;
}
std::uint64_t PageTable::clusters() const {
  std::uint64_t sum = 0;
  for (const PageEntry& p : pages) sum += p.clusters;
  return sum;
}
std::uint32_t PageTable::largestPage() const {
  std::uint32_t most = 0;
  for (const PageEntry& p : pages) most = std::max(most, p.bytes);
  return most;
}

std::vector<std::byte> PageTable::toBytes() const {
  TableHeader h{};
  std::memcpy(h.magic, kTableMagic, sizeof(h.magic));
  h.version = kPageTableVersion;
  h.stepExponent = stepExponent;
  h.pages = pages.size();
  h.groups = groups.size();
  h.triangles = triangles;
  h.droppedTriangles = droppedTriangles;
  Sizes copy = sizes;
  forSizes(copy, [&](int i, std::uint64_t& value) { h.sizes[i] = value; });
  std::copy_n(lower, 3, h.lower);
  std::copy_n(upper, 3, h.upper);
  std::vector<std::byte> out(sizeof(h) + pages.size() * sizeof(PageEntry) +
                             groups.size() * sizeof(PageGroup));
  std::byte* at = out.data();
  std::memcpy(at, &h, sizeof(h));
  at += sizeof(h);
  if (!pages.empty()) std::memcpy(at, pages.data(), pages.size() * sizeof(PageEntry));
  at += pages.size() * sizeof(PageEntry);
  if (!groups.empty()) std::memcpy(at, groups.data(), groups.size() * sizeof(PageGroup));
  h.checksum = checksumOfTable(out);
  std::memcpy(out.data(), &h, sizeof(h));
  return out;
}

PageTable PageTable::fromBytes(std::span<const std::byte> bytes, std::uint64_t sectionBytes) {
  TableHeader h;
  check(bytes.size() >= sizeof(h), "truncated header", bytes.size());
  std::memcpy(&h, bytes.data(), sizeof(h));
  check(std::memcmp(h.magic, kTableMagic, sizeof(h.magic)) == 0, "wrong magic", 0);
  check(h.version == kPageTableVersion, "unknown version", 8);
  check(h.checksum == checksumOfTable(bytes), "wrong checksum", 16);
  check(h.stepExponent >= layout::kMinStepExponent && h.stepExponent <= layout::kMaxStepExponent,
        "step out of range", 12);
  const std::uint64_t room = bytes.size() - sizeof(h);
  check(h.pages <= kMostPages && h.groups <= room / sizeof(PageGroup) &&
            h.pages * sizeof(PageEntry) + h.groups * sizeof(PageGroup) == room,
        "wrong number of pages or groups", 24);
  PageTable t;
  t.stepExponent = h.stepExponent;
  t.triangles = h.triangles;
  t.droppedTriangles = h.droppedTriangles;
  forSizes(t.sizes, [&](int i, std::uint64_t& value) { value = h.sizes[i]; });
  for (int k = 0; k < 3; ++k) {
    check(std::isfinite(h.lower[k]) && std::isfinite(h.upper[k]), "bounds not finite", 136);
    t.lower[k] = h.lower[k], t.upper[k] = h.upper[k];
  }
  t.pages.resize(h.pages);
  t.groups.resize(h.groups);
  const std::byte* at = bytes.data() + sizeof(h);
  if (h.pages > 0) std::memcpy(t.pages.data(), at, h.pages * sizeof(PageEntry));
  at += h.pages * sizeof(PageEntry);
  if (h.groups > 0) std::memcpy(t.groups.data(), at, h.groups * sizeof(PageGroup));
  checkPages(t, sectionBytes);
  checkGroups(t);
  return t;
}

void readPage(const PageFile& file, const PageTable& table, std::uint32_t page,
              std::vector<std::byte>& packed) {
  const PageEntry& entry = table.pages[page];
  packed.resize(entry.packedBytes);
  const FilePart whole{entry.offset, packed, entry.checksum};
  file.readAll({&whole, 1});
}

ClusterPage loadPage(const PageFile& file, const PageTable& table, std::uint32_t page, bool known) {
  thread_local std::vector<std::byte> packed;  // one a thread, not counted by caches
  readPage(file, table, page, packed);
  return unpackPage(file, table, page, packed, known);
}

ClusterPage unpackPage(const PageFile& file, const PageTable& table, std::uint32_t page,
                       std::span<const std::byte> packed, bool known) {
  const PageEntry& entry = table.pages[page];
  const auto bad = [&](const std::string& what) {
    throw FormatError(file.place(entry.offset) + ": page " + std::to_string(page) + " " + what);
  };
  if (XXH3_64bits(packed.data(), packed.size()) != entry.checksum) bad("has a wrong checksum");
  ClusterPage out;
  try {
    if (unpackedBytes(packed) != entry.bytes) bad("has another size than the table says");
    out = unpackClusters(packed, known);
  } catch (const FormatError& e) {
    bad(std::string("is damaged: ") + e.what());
  }
  if (out.count() != entry.clusters) bad("has another number of clusters than the table says");
  return out;
}

Mesh Mesh::fromPage(const ClusterPage& page, const Mesh& grid) {
  layout::Header header;
  std::memcpy(&header, grid.bytes().data(), sizeof(header));
  const std::size_t start = pageBytes(page.count(), 0);
  header.clusterCount = static_cast<std::uint32_t>(page.count());
  header.byteSize = pageBytes(page.count(), page.bytes.size());
  const std::shared_ptr<std::byte[]> bytes =
      std::make_unique_for_overwrite<std::byte[]>(header.byteSize);
  std::memcpy(bytes.get(), &header, sizeof(header));
  for (std::size_t i = 0; i < page.count(); ++i) {
    const auto place = static_cast<std::uint32_t>((start + page.offsets[i]) >> layout::kTableShift);
    std::memcpy(bytes.get() + sizeof(header) + 4 * i, &place, sizeof(place));
  }
  const std::size_t tableEnd = sizeof(header) + 4 * page.count();
  std::memset(bytes.get() + tableEnd, 0, start - tableEnd);
  if (!page.bytes.empty()) std::memcpy(bytes.get() + start, page.bytes.data(), page.bytes.size());
  return Mesh(std::span<const std::byte>(bytes.get(), header.byteSize), bytes, grid);
}

Mesh Mesh::fromPageAgain(std::span<const std::byte> bytes, std::shared_ptr<const void> owner,
                         const Mesh& grid) {
  return Mesh(bytes, std::move(owner), grid);
}

std::size_t Mesh::pageBytes(std::size_t clusters, std::size_t blobs) {
  return (sizeof(layout::Header) + 4 * clusters + layout::kBlobUnit - 1) / layout::kBlobUnit *
             layout::kBlobUnit +
         blobs;
}

}  // namespace hccm
