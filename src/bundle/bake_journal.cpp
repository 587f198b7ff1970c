#include "src/bundle/bake_journal.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "src/core/error.h"

namespace trex::bundle {
namespace {

enum RecordType : std::uint32_t { kKey = 1, kSpill = 2, kBucket = 3 };

struct RecordHeader {
  std::uint32_t type = 0, zero = 0;
  std::uint64_t bytes = 0;
};

template <typename T>
void put(std::vector<std::byte>& out, const T& value) {
  const auto* bytes = reinterpret_cast<const std::byte*>(&value);
  out.insert(out.end(), bytes, bytes + sizeof(value));
}

template <typename T>
bool take(std::span<const std::byte>& from, T& value) {
  if (from.size() < sizeof(value)) return false;
  std::memcpy(static_cast<void*>(&value), from.data(), sizeof(value));
  from = from.subspan(sizeof(value));
  return true;
}

std::vector<std::byte> bytesOf(const FinishedBucket& b) {
  std::vector<std::byte> out;
  put(out, b.bucket);
  put(out, std::uint64_t{b.pages.size()});
  for (const hccm::BuiltPage& p : b.pages) {
    put(out, p.entry);
    put(out, p.sizes);
    put(out, std::uint64_t{p.groups.size()});
    for (const hccm::PageGroup& g : p.groups) put(out, g);
  }
  return out;
}

bool read(std::span<const std::byte> bytes, FinishedBucket& b) {
  std::uint64_t pages = 0, groups = 0;
  if (!take(bytes, b.bucket) || !take(bytes, pages)) return false;
  for (std::uint64_t i = 0; i < pages; ++i) {
    hccm::BuiltPage& p = b.pages.emplace_back();
    if (!take(bytes, p.entry) || !take(bytes, p.sizes) || !take(bytes, groups)) return false;
    for (std::uint64_t k = 0; k < groups; ++k) {
      if (!take(bytes, p.groups.emplace_back())) return false;
    }
  }
  return bytes.empty();
}

/// All of a file; what can't be read counts as its end.
std::vector<std::byte> contentsOf(int file) {
  std::vector<std::byte> out;
  std::vector<std::byte> block(std::size_t{1} << 20);
  for (;;) {
    const ssize_t got = ::pread(file, block.data(), block.size(), static_cast<off_t>(out.size()));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return out;
    out.insert(out.end(), block.begin(), block.begin() + got);
  }
}

}  // namespace

BakeJournal::BakeJournal(const std::filesystem::path& path, const std::string& key, bool resume)
    : path_(path), file_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
  if (file_ < 0) failed();
  if (::flock(file_, LOCK_EX | LOCK_NB) != 0) {
    ::close(file_);
    fail(ExitCode::kOutput, "{}: another bake of the same target is running", path_.string());
  }
  if (resume) load(key);
  if (end_ == 0) record(kKey, std::as_bytes(std::span(key)));
  if (keyEnd_ == 0) keyEnd_ = end_;
}

BakeJournal::~BakeJournal() { ::close(file_); }

void BakeJournal::failed() const {
  fail(ExitCode::kOutput, "{}: can't be written: {}", path_.string(), std::strerror(errno));
}

void BakeJournal::load(const std::string& key) {
  const std::vector<std::byte> all = contentsOf(file_);
  std::span<const std::byte> rest(all);
  for (RecordHeader h; rest.size() >= sizeof(h);) {
    std::span<const std::byte> at = rest;
    take(at, h);
    if (h.bytes > at.size() || at.size() - h.bytes < sizeof(std::uint64_t)) return;
    const std::span<const std::byte> bytes = at.first(h.bytes);
    at = at.subspan(h.bytes);
    std::uint64_t checksum = 0;
    take(at, checksum);
    if (XXH3_64bits(rest.data(), sizeof(h) + h.bytes) != checksum) return;
    if (end_ == 0) {
      const bool same = h.type == kKey && bytes.size() == key.size() &&
                        std::memcmp(bytes.data(), key.data(), key.size()) == 0;
      if (!same) {
        wasOther_ = true;
        return;
      }
    } else if (h.type == kSpill) {
      spill_ = hccm::Spill::fromBytes(bytes);
    } else if (h.type == kBucket) {
      FinishedBucket b;
      if (!read(bytes, b) || b.bucket != buckets_.size()) return;
      buckets_.push_back(std::move(b));
    }
    end_ += sizeof(h) + h.bytes + sizeof(checksum);
    rest = at;
    if (h.type == kKey) keyEnd_ = end_;
    if (h.type == kSpill) spillEnd_ = end_;
    if (h.type == kBucket) bucketEnds_.push_back(end_);
  }
}

void BakeJournal::cut(std::size_t buckets, bool keepSpill) {
  end_ = buckets > 0 ? bucketEnds_[buckets - 1] : keepSpill && spillEnd_ > 0 ? spillEnd_ : keyEnd_;
  bucketEnds_.resize(buckets);
  if (buckets_.size() > buckets) buckets_.resize(buckets);
  if (!keepSpill) spillEnd_ = 0;
  if (::ftruncate(file_, static_cast<off_t>(end_)) != 0) failed();
}

void BakeJournal::record(std::uint32_t type, std::span<const std::byte> bytes) {
  std::vector<std::byte> out;
  put(out, RecordHeader{type, 0, bytes.size()});
  out.insert(out.end(), bytes.begin(), bytes.end());
  put(out, XXH3_64bits(out.data(), out.size()));
  if (end_ == 0 && ::ftruncate(file_, 0) != 0) failed();
  for (std::span<const std::byte> rest(out); !rest.empty();) {
    const ssize_t got = ::pwrite(file_, rest.data(), rest.size(), static_cast<off_t>(end_));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) failed();
    rest = rest.subspan(static_cast<std::size_t>(got));
    end_ += static_cast<std::uint64_t>(got);
  }
}

void BakeJournal::add(const hccm::Spill& spill) {
  record(kSpill, spill.toBytes());
  spillEnd_ = end_;
}

void BakeJournal::add(const FinishedBucket& bucket) {
  record(kBucket, bytesOf(bucket));
  bucketEnds_.push_back(end_);
}

}  // namespace trex::bundle
