#include "src/bundle/container_stream.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "src/bundle/layout.h"
#include "src/core/error.h"

namespace trex::bundle {

struct ContainerStream::Hash {
  XXH3_state_t state;
  std::uint64_t bytes = 0;
  Hash() { XXH3_64bits_reset(&state); }
};

ContainerStream::ContainerStream(const std::filesystem::path& path, std::string name,
                                 const std::string& firstSection, std::uint64_t keptBytes)
    : name_(std::move(name)), end_(sizeof(Header)), hash_(std::make_unique<Hash>()) {
  const int mode = keptBytes > 0 ? 0 : O_TRUNC;
  file_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | mode, 0666);
  if (file_ < 0) failed();
  sections_.push_back({firstSection, end_, keptBytes});
  if (keptBytes > 0) rehash(keptBytes);
  if (::ftruncate(file_, static_cast<off_t>(end_)) != 0) failed();
}

ContainerStream::~ContainerStream() {
  if (file_ >= 0) ::close(file_);
}

void ContainerStream::failed() const {
  fail(ExitCode::kOutput, "{}: can't be written: {}", name_, std::strerror(errno));
}

void ContainerStream::rehash(std::uint64_t bytes) {
  std::vector<std::byte> buffer(std::size_t{4} << 20);
  while (bytes > 0) {
    const std::size_t want = std::min<std::uint64_t>(bytes, buffer.size());
    const ssize_t got = ::pread(file_, buffer.data(), want, static_cast<off_t>(end_));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) failed();
    hash(std::span(buffer).first(static_cast<std::size_t>(got)));
    end_ += static_cast<std::uint64_t>(got);
    bytes -= static_cast<std::uint64_t>(got);
  }
}

void ContainerStream::put(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t got = ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) failed();
    bytes = bytes.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
}

void ContainerStream::hash(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const std::size_t take = std::min<std::uint64_t>(kPageBytes - hash_->bytes, bytes.size());
    XXH3_64bits_update(&hash_->state, bytes.data(), take);
    hash_->bytes += take;
    bytes = bytes.subspan(take);
    if (hash_->bytes < kPageBytes) continue;
    hashes_.push_back(XXH3_64bits_digest(&hash_->state));
    *hash_ = Hash();
  }
}

void ContainerStream::append(std::span<const std::byte> bytes) {
  put(end_, bytes);
  hash(bytes);
  end_ += bytes.size();
}

void ContainerStream::write(std::span<const std::byte> bytes) {
  append(bytes);
  sections_.back().bytes += bytes.size();
}

void ContainerStream::endSection() {
  static constexpr std::byte kZeros[kAlignment] = {};
  append({kZeros, aligned(end_) - end_});
}

void ContainerStream::section(const std::string& name) {
  endSection();
  sections_.push_back({name, end_, 0});
}

std::vector<Section> ContainerStream::finish() {
  endSection();
  if (hash_->bytes > 0) hashes_.push_back(XXH3_64bits_digest(&hash_->state));
  std::vector<std::byte> directory(sections_.size() * sizeof(Entry) + 8 * hashes_.size());
  std::byte* at = directory.data();
  for (const Section& s : sections_) {
    Entry entry{};
    std::memcpy(entry.name, s.name.data(), std::min(s.name.size(), sizeof(entry.name) - 1));
    entry.offset = s.offset;
    entry.bytes = s.bytes;
    std::memcpy(at, &entry, sizeof(entry));
    at += sizeof(entry);
  }
  if (!hashes_.empty()) std::memcpy(at, hashes_.data(), 8 * hashes_.size());
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof(kMagic));
  header.version = kVersion;
  header.byteOrder = kByteOrder;
  header.fileBytes = end_ + directory.size();
  header.directoryOffset = end_;
  header.directoryHash = XXH3_64bits(directory.data(), directory.size());
  header.sectionCount = static_cast<std::uint32_t>(sections_.size());
  header.hash = XXH3_64bits(&header, offsetof(Header, hash));
  put(end_, directory);
  if (::fsync(file_) != 0) failed();
  put(0, {reinterpret_cast<const std::byte*>(&header), sizeof(header)});
  if (::fsync(file_) != 0) failed();
  return sections_;
}

}  // namespace trex::bundle
