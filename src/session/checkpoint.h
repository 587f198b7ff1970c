// Checkpoints: the state of a render on disk, so that it can go on later with the same bits.
//
// A file is a header (see checkpoint.cpp), the sums of the frame as they lie in memory, and an XXH3
// of all before it. Little endian, and of one build's layout: another version refuses it. It is
// written beside its name and renamed, so a killed process leaves the one before.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "src/frame/accumulator.h"
#include "src/paths/path_sample.h"

namespace trex {

/// What a checkpoint says besides the sums.
struct CheckpointHeader {
  std::uint64_t key = 0;          ///< of the job: scene, view and settings
  std::uint32_t frame = 0;        ///< of a path
  std::uint32_t samplesDone = 0;  ///< complete passes
  std::uint32_t tilesDone = 0;    ///< of the pass under way
  std::uint32_t errorCheck = 0;
  double renderSeconds = 0.0, error = 0.0;
  double coneShare = 0.0;  ///< Session::coneShare(): it is kept
  RayCounts rays;
  std::uint64_t nonFinite = 0;
  std::vector<NonFiniteSample> nonFiniteSamples;  ///< at most 16
};

/// Throws Error(kOutput); the file at `path` is then as it was.
void writeCheckpoint(const std::filesystem::path& path, const CheckpointHeader& header,
                     std::span<const std::span<std::byte>> parts);

class CheckpointReader {
 public:
  /// Opens a file and checks its header and the checksum of the whole. Throws Error(kInput).
  explicit CheckpointReader(const std::filesystem::path& path);
  const CheckpointHeader& header() const { return header_; }
  /// Fills all parts; they must have the sizes they were written with.
  void read(std::span<const std::span<std::byte>> parts);
  /// Throws Error(kInput) that names the file and says what to do.
  [[noreturn]] void refuse(const std::string& reason) const;

 private:
  std::filesystem::path path_;
  std::ifstream file_;
  CheckpointHeader header_;
  std::uint64_t payloadBytes_ = 0;
};

}  // namespace trex
