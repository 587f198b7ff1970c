// Pages from a file as if it had never been read, and from a disk that is slower than this one's.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>

#include "src/bundle/page_file.h"

namespace trex {

/// A disk that serves one request at a time; thread safe.
class SlowDisk {
 public:
  /// Bytes a second (0: as fast as the file) and seconds of each request.
  SlowDisk(double bandwidth, double latency) : bandwidth_(bandwidth), latency_(latency) {}
  /// Returns when this disk would have served a request for so many bytes.
  void serve(std::size_t bytes);

 private:
  double bandwidth_, latency_;
  std::mutex mutex_;
  double free_ = 0.0;  ///< secondsNow() when the requests so far are served
};

/// Reads past the system's cache (O_DIRECT), where the file system can.
class ColdPages : public hccm::PageFile {
 public:
  /// As FilePages. `disk` may be null.
  ColdPages(const std::filesystem::path& path, std::uint64_t start, std::shared_ptr<SlowDisk> disk);
  ~ColdPages() override;
  ColdPages(const ColdPages&) = delete;
  ColdPages& operator=(const ColdPages&) = delete;
  void read(std::uint64_t offset, std::span<std::byte> out) const override;
  /// Nothing is read before it is asked for.
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override { return warm_.place(offset); }
  /// Whether the system's cache is passed by.
  bool isCold() const { return file_ >= 0; }

 private:
  bundle::FilePages warm_;  ///< of the same bytes, where the cache can't be passed by
  std::uint64_t start_;
  std::shared_ptr<SlowDisk> disk_;
  int file_;
};

}  // namespace trex
