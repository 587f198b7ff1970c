// Reading and checking the file of a bundle.
#include "src/bundle/container.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "src/bundle/layout.h"
#include "src/core/error.h"

namespace trex::bundle {
namespace {

std::uint64_t hashOf(std::span<const std::byte> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

bool allZero(std::span<const std::byte> bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](std::byte b) { return b == std::byte{}; });
}

Header readHeader(std::span<const std::byte> bytes, const std::string& name) {
  Header header;
  if (!hasBundleMagic(bytes)) fail(ExitCode::kInput, "{}: not a trex bundle", name);
  if (bytes.size() < sizeof(Header)) {
    fail(ExitCode::kInput, "{}: truncated: {} bytes are no bundle; bake again", name, bytes.size());
  }
  std::memcpy(&header, bytes.data(), sizeof(header));
  if (header.version != kVersion) {
    fail(ExitCode::kInput, "{}: bundle of version {}, this program reads {}; bake again", name,
         header.version, kVersion);
  }
  if (header.byteOrder != kByteOrder) {
    fail(ExitCode::kInput, "{}: written with another byte order; bake again", name);
  }
  if (header.hash != hashOf(bytes.first(offsetof(Header, hash)))) {
    fail(ExitCode::kInput, "{}: damaged: the header's checksum differs; bake again", name);
  }
  if (header.fileBytes != bytes.size()) {
    fail(ExitCode::kInput, "{}: {}: its header says {} bytes, the file has {}; bake again", name,
         header.fileBytes > bytes.size() ? "truncated" : "something follows its end",
         header.fileBytes, bytes.size());
  }
  return header;
}

/// The name, or nothing if it is not one.
std::string nameOf(const Entry& entry) {
  const char* end = std::find(entry.name, entry.name + sizeof(entry.name), '\0');
  const std::string name(entry.name, end);
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.';
  });
  const bool padded = end != entry.name + sizeof(entry.name) &&
                      std::all_of(end, entry.name + sizeof(entry.name), [](char c) { return !c; });
  return plain && padded ? name : std::string();
}

}  // namespace

bool hasBundleMagic(std::span<const std::byte> bytes) {
  return bytes.size() >= sizeof(kMagic) && std::memcmp(bytes.data(), kMagic, sizeof(kMagic)) == 0;
}

Container::Container(std::span<const std::byte> bytes, std::string name, Fetch fetch)
    : bytes_(bytes), name_(std::move(name)), fetch_(std::move(fetch)) {
  this->fetch(0, std::min(bytes.size(), sizeof(Header)));
  const Header header = readHeader(bytes, name_);
  digest_ = header.hash;
  const std::uint64_t offset = header.directoryOffset;
  if (offset < sizeof(Header) || offset % kAlignment != 0 || offset > bytes.size()) {
    fail(ExitCode::kInput, "{}: the directory is misplaced; bake again", name_);
  }
  const std::uint64_t pages = (offset - sizeof(Header) + kPageBytes - 1) / kPageBytes;
  const std::uint64_t expected = std::uint64_t{header.sectionCount} * sizeof(Entry) + 8 * pages;
  if (header.sectionCount > kMaxSections || bytes.size() - offset != expected) {
    fail(ExitCode::kInput, "{}: the directory has the wrong size; bake again", name_);
  }
  this->fetch(offset, expected);
  if (hashOf(bytes.subspan(offset)) != header.directoryHash) {
    fail(ExitCode::kInput, "{}: damaged: the directory's checksum differs; bake again", name_);
  }
  readDirectory(offset, header.sectionCount);
  pageChecked_.resize(pages);
}

void Container::readDirectory(std::uint64_t offset, std::uint32_t count) {
  std::uint64_t next = sizeof(Header);
  sections_.reserve(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    Entry entry;
    std::memcpy(&entry, bytes_.data() + offset + i * sizeof(Entry), sizeof(entry));
    sections_.push_back({nameOf(entry), entry.offset, entry.bytes});
    if (sections_.back().name.empty() || entry.offset != next || entry.bytes > offset - next) {
      fail(ExitCode::kInput, "{}: section {} has a wrong name or place; bake again", name_, i);
    }
    next = aligned(next + entry.bytes);
    index_.emplace(sections_.back().name, i);
  }
  if (next != offset || index_.size() != count) {
    fail(ExitCode::kInput, "{}: {}; bake again", name_,
         next != offset ? "sections do not fill the file" : "two sections have one name");
  }
  pagesEnd_ = offset;
  hashes_ = bytes_.data() + offset + count * sizeof(Entry);
}

bool Container::has(std::string_view section) const { return index_.contains(section); }

const Section& Container::find(std::string_view section) const {
  const auto found = index_.find(section);
  if (found == index_.end()) {
    fail(ExitCode::kInput, "{}: has no section {}; bake again", name_, section);
  }
  return sections_[found->second];
}

std::span<const std::byte> Container::section(std::string_view section) const {
  const Section& s = find(section);
  const std::uint64_t start = s.offset - sizeof(Header);
  checkPages(start / kPageBytes, (start + s.bytes + kPageBytes - 1) / kPageBytes);
  return bytes_.subspan(s.offset, s.bytes);
}

std::span<const std::byte> Container::uncheckedSection(std::string_view section) const {
  const Section& s = find(section);
  return bytes_.subspan(s.offset, s.bytes);
}

std::uint64_t Container::offsetOf(std::string_view section) const { return find(section).offset; }

std::string Container::sectionAt(std::uint64_t offset) const {
  const auto after =
      std::upper_bound(sections_.begin(), sections_.end(), offset,
                       [](std::uint64_t at, const Section& s) { return at < s.offset; });
  return after == sections_.begin() ? "none" : std::prev(after)->name;
}

void Container::fetch(std::uint64_t offset, std::uint64_t count) const {
  if (fetch_ && count > 0) fetch_(offset, count);
}

/// Those that are not there yet, as many at once as follow each other.
void Container::fetchPages(std::uint64_t first, std::uint64_t end) const {
  if (!fetch_) return;
  for (std::uint64_t at = first; at < end;) {
    if (pageChecked_[at]) {
      ++at;
      continue;
    }
    std::uint64_t next = at;
    while (next < end && !pageChecked_[next]) ++next;
    const std::uint64_t from = sizeof(Header) + at * kPageBytes;
    fetch(from, std::min(sizeof(Header) + next * kPageBytes, pagesEnd_) - from);
    at = next;
  }
}

void Container::checkPages(std::uint64_t first, std::uint64_t end) const {
  fetchPages(first, end);
  std::atomic<std::uint64_t> bad = ~std::uint64_t{0};
  tbb::parallel_for(first, end, [&](std::uint64_t page) {
    if (pageChecked_[page]) return;
    const std::uint64_t at = sizeof(Header) + page * kPageBytes;
    std::uint64_t expected;
    std::memcpy(&expected, hashes_ + 8 * page, sizeof(expected));
    if (hashOf(bytes_.subspan(at, std::min(kPageBytes, pagesEnd_ - at))) == expected) {
      pageChecked_[page] = 1;
      return;
    }
    std::uint64_t known = bad.load();
    while (page < known && !bad.compare_exchange_weak(known, page)) {
    }
  });
  if (bad == ~std::uint64_t{0}) return;
  const std::uint64_t at = sizeof(Header) + bad * kPageBytes;
  const std::uint64_t last = std::min(at + kPageBytes, pagesEnd_) - 1;
  const std::string from = sectionAt(at), to = sectionAt(last);
  fail(ExitCode::kInput,
       "{}: damaged: page {} (bytes {} to {}, section {}) does not match its "
       "checksum; bake again",
       name_, bad.load(), at, last, from == to ? from : from + " to " + to);
}

void Container::verify() const {
  checkPages(0, pageChecked_.size());
  for (const Section& s : sections_) {
    const std::uint64_t end = s.offset + s.bytes;
    if (!allZero(bytes_.subspan(end, aligned(end) - end))) {
      fail(ExitCode::kInput, "{}: padding behind section {} is not zero; bake again", name_,
           s.name);
    }
  }
  if (!allZero(bytes_.subspan(offsetof(Header, reserved), sizeof(Header::reserved)))) {
    fail(ExitCode::kInput, "{}: reserved bytes of the header are not zero; bake again", name_);
  }
}

std::uint64_t Container::pagesChecked() const {
  return static_cast<std::uint64_t>(std::count(pageChecked_.begin(), pageChecked_.end(), 1));
}

}  // namespace trex::bundle
