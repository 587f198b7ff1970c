// Any bytes as a page table and its pages: what is accepted is traced and decoded. The input is the
// table's length (u32), the table, the pages. The mutator repairs lengths and checksums, else
// nothing would get past them.
#define XXH_INLINE_ALL
#include <xxhash.h>

#include <cstring>
#include <random>

#include "hccmesh/page_cache.h"
#include "tests/fuzz/fuzz.h"

namespace {

using hccm::PageEntry;
using hccm::PageTable;
using trex::fuzz::require;
using Bytes = std::vector<std::byte>;

constexpr std::size_t kHeader = 160, kChecksum = 16, kPages = 24;

class Pages : public hccm::PageFile {
 public:
  explicit Pages(std::span<const std::byte> bytes) : bytes_(bytes.begin(), bytes.end()) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    require(offset <= bytes_.size() && out.size() <= bytes_.size() - offset);
    if (!out.empty()) std::memcpy(out.data(), bytes_.data() + offset, out.size());
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override { return std::to_string(offset); }

 private:
  Bytes bytes_;
};

void trace(const hccm::PagedMesh& mesh) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(-0.2f, 1.2f);
  const PageTable& table = mesh.table();
  const auto point = [&] {
    glm::vec3 p;
    for (int k = 0; k < 3; ++k)
      p[k] = table.lower[k] + (table.upper[k] - table.lower[k]) * unit(random);
    return p;
  };
  hccm::PagedMesh::Pin pin;
  for (int i = 0; i < 8; ++i) {
    const glm::vec3 from = point(), to = point();
    hccm::PreparedRay ray = mesh.prepare({from, 0.0f, to - from, INFINITY});
    hccm::Hit hit;
    for (std::uint32_t g = 0; g < mesh.groupCount(); ++g) {
      mesh.occluded(g, ray, pin);
      mesh.intersect(g, ray, hit, pin);
    }
    pin.release();
    if (hit.cluster != hccm::Hit::kNothing) mesh.triangle(hit.cluster, hit.triangle);
  }
}

/// Makes the checksums of a table and its pages those that they should be.
void repair(Bytes& table, std::span<const std::byte> pages) {
  if (table.size() < kHeader) return;
  std::uint64_t count;
  std::memcpy(&count, table.data() + kPages, sizeof(count));
  for (std::uint64_t i = 0; i < count && kHeader + (i + 1) * sizeof(PageEntry) <= table.size();
       ++i) {
    PageEntry e;
    std::byte* at = table.data() + kHeader + i * sizeof(PageEntry);
    std::memcpy(&e, at, sizeof(e));
    if (e.offset > pages.size() || e.packedBytes > pages.size() - e.offset) continue;
    e.checksum = XXH3_64bits(pages.data() + e.offset, e.packedBytes);
    std::memcpy(at, &e, sizeof(e));
  }
  std::byte header[kHeader];
  std::memcpy(header, table.data(), kHeader);
  std::memset(header + kChecksum, 0, 8);
  const std::uint64_t seed = XXH3_64bits(header, kHeader);
  const std::uint64_t hash =
      XXH3_64bits_withSeed(table.data() + kHeader, table.size() - kHeader, seed);
  std::memcpy(table.data() + kChecksum, &hash, sizeof(hash));
}

struct Input {
  Bytes table, pages;
  Input(const std::uint8_t* data, std::size_t size) {
    std::uint32_t length = 0;
    if (size < sizeof(length)) return;
    std::memcpy(&length, data, sizeof(length));
    const auto rest = std::as_bytes(std::span(data, size)).subspan(sizeof(length));
    const std::size_t cut = std::min<std::size_t>(length, rest.size());
    table.assign(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(cut));
    pages.assign(rest.begin() + static_cast<std::ptrdiff_t>(cut), rest.end());
  }
};

Bytes mutated(const Bytes& from, std::size_t most) {
  Bytes out = from;
  out.resize(std::min(from.size() + 64, most));
  if (out.empty()) return out;
  out.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(out.data()),
                              std::min(from.size(), out.size()), out.size()));
  return out;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Input input(data, size);
  try {
    PageTable table = PageTable::fromBytes(input.table, input.pages.size());
    if (table.bytes() > (1u << 24)) return 0;
    const std::uint64_t least = hccm::PageCache::leastBytes(table);
    const hccm::PagedMesh mesh(std::move(table), std::make_unique<Pages>(input.pages),
                               std::max<std::uint64_t>(least, 1), 8);
    trace(mesh);
  } catch (const hccm::FormatError&) {
    // Expected.
  }
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  Input input(data, size);
  if (most < 512) return size;
  std::minstd_rand random(seed);
  // A change of pages keeps their lengths mostly, so that the table still fits.
  if (random() % 2 == 0) {
    const std::size_t length = input.pages.size();
    input.pages = mutated(input.pages, most / 2);
    if (random() % 4 != 0) input.pages.resize(length);
  } else {
    input.table = mutated(input.table, most / 2 - 4);
  }
  repair(input.table, input.pages);
  const auto length = static_cast<std::uint32_t>(input.table.size());
  if (4 + input.table.size() + input.pages.size() > most) return size;
  std::memcpy(data, &length, 4);
  if (length > 0) std::memcpy(data + 4, input.table.data(), length);
  if (!input.pages.empty()) std::memcpy(data + 4 + length, input.pages.data(), input.pages.size());
  return 4 + input.table.size() + input.pages.size();
}
