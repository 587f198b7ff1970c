// What a streaming bake has done so far, kept beside its target so that the next one can go on.
//
// A file of records: type (u32), zero (u32), length (u64), bytes, XXH3-64 of all of these. The
// first names the job; a record that is cut off or damaged ends the journal.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "hccmesh/pages.h"
#include "hccmesh/stream.h"

namespace trex::bundle {

/// Pages of one finished bucket.
struct FinishedBucket {
  std::uint64_t bucket = 0;
  std::vector<hccm::BuiltPage> pages;  ///< without their packed bytes
};

class BakeJournal {
 public:
  /// Opens the journal and locks it. Throws Error(kOutput) if another process holds it, or it can't
  /// be written. With `resume` and an equal key, what is in it can be taken; else it starts empty.
  BakeJournal(const std::filesystem::path& path, const std::string& key, bool resume);
  ~BakeJournal();
  BakeJournal(const BakeJournal&) = delete;
  BakeJournal& operator=(const BakeJournal&) = delete;

  /// Whether there was a journal of another job.
  bool wasOther() const { return wasOther_; }
  std::optional<hccm::Spill> takeSpill() { return std::move(spill_); }
  /// Buckets 0, 1, ... in order.
  std::vector<FinishedBucket> takeBuckets() { return std::move(buckets_); }

  /// Forgets everything but the first `buckets` buckets (and the spill, unless it is to go too).
  void cut(std::size_t buckets, bool keepSpill);
  void add(const hccm::Spill& spill);
  void add(const FinishedBucket& bucket);

 private:
  void load(const std::string& key);
  void record(std::uint32_t type, std::span<const std::byte> bytes);
  [[noreturn]] void failed() const;

  std::filesystem::path path_;
  int file_;
  std::uint64_t end_ = 0, spillEnd_ = 0, keyEnd_ = 0;
  std::vector<std::uint64_t> bucketEnds_;
  bool wasOther_ = false;
  std::optional<hccm::Spill> spill_;
  std::vector<FinishedBucket> buckets_;
};

}  // namespace trex::bundle
