// Writing the file of a bundle.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "src/bundle/layout.h"

namespace trex::bundle {
namespace {

constexpr std::byte kZeros[kAlignment] = {};

/// Sections and padding as one stretch of bytes that starts behind the header.
class Stretch {
 public:
  explicit Stretch(std::span<const SectionData> sections) {
    for (const SectionData& s : sections) {
      add(s.bytes);
      add({kZeros, aligned(s.bytes.size()) - s.bytes.size()});
    }
  }
  std::uint64_t bytes() const { return ends_.empty() ? 0 : ends_.back(); }

  /// Hash of [begin, end).
  std::uint64_t hash(std::uint64_t begin, std::uint64_t end) const {
    XXH3_state_t state;
    XXH3_64bits_reset(&state);
    auto i = static_cast<std::size_t>(std::upper_bound(ends_.begin(), ends_.end(), begin) -
                                      ends_.begin());
    for (; begin < end; ++i) {
      const std::uint64_t start = ends_[i] - pieces_[i].size();
      const std::uint64_t stop = std::min(end, ends_[i]);
      XXH3_64bits_update(&state, pieces_[i].data() + (begin - start), stop - begin);
      begin = stop;
    }
    return XXH3_64bits_digest(&state);
  }

 private:
  void add(std::span<const std::byte> piece) {
    if (piece.empty()) return;
    pieces_.push_back(piece);
    ends_.push_back(bytes() + piece.size());
  }
  std::vector<std::span<const std::byte>> pieces_;
  std::vector<std::uint64_t> ends_;
};

std::vector<std::byte> directoryOf(std::span<const SectionData> sections) {
  const Stretch stretch(sections);
  const std::uint64_t pages = (stretch.bytes() + kPageBytes - 1) / kPageBytes;
  std::vector<std::byte> out(sections.size() * sizeof(Entry) + 8 * pages);
  std::uint64_t offset = sizeof(Header);
  std::byte* at = out.data();
  for (const SectionData& s : sections) {
    Entry entry{};
    assert(!s.name.empty() && s.name.size() < sizeof(entry.name));
    std::memcpy(entry.name, s.name.data(), s.name.size());
    entry.offset = offset;
    entry.bytes = s.bytes.size();
    std::memcpy(at, &entry, sizeof(entry));
    at += sizeof(entry);
    offset += aligned(s.bytes.size());
  }
  tbb::parallel_for(std::uint64_t{0}, pages, [&](std::uint64_t page) {
    const std::uint64_t begin = page * kPageBytes;
    const std::uint64_t hash = stretch.hash(begin, std::min(begin + kPageBytes, stretch.bytes()));
    std::memcpy(at + 8 * page, &hash, sizeof(hash));
  });
  return out;
}

}  // namespace

std::uint64_t containerBytes(std::span<const SectionData> sections) {
  std::uint64_t bytes = 0;
  for (const SectionData& s : sections) bytes += aligned(s.bytes.size());
  return sizeof(Header) + bytes + sections.size() * sizeof(Entry) +
         (bytes + kPageBytes - 1) / kPageBytes * 8;
}

void writeContainer(std::span<const SectionData> sections,
                    const std::function<void(std::span<const std::byte>)>& sink) {
  const std::vector<std::byte> directory = directoryOf(sections);
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof(kMagic));
  header.version = kVersion;
  header.byteOrder = kByteOrder;
  header.fileBytes = containerBytes(sections);
  header.directoryOffset = header.fileBytes - directory.size();
  header.directoryHash = XXH3_64bits(directory.data(), directory.size());
  header.sectionCount = static_cast<std::uint32_t>(sections.size());
  header.hash = XXH3_64bits(&header, offsetof(Header, hash));
  sink({reinterpret_cast<const std::byte*>(&header), sizeof(header)});
  for (const SectionData& s : sections) {
    if (!s.bytes.empty()) sink(s.bytes);
    const std::uint64_t padding = aligned(s.bytes.size()) - s.bytes.size();
    if (padding > 0) sink({kZeros, padding});
  }
  sink(directory);
}

}  // namespace trex::bundle
