// Baking models that are larger than memory.
//
//   stream ─ spillTriangles ─► .X.bake-spill.tmp
//                 buildPages ─► .X.bake.tmp (the bundle, front to back) + .X.bake-journal.tmp
//       pages ─ asvo::Tree ──► voxels
//                              renamed to X.trex; the other two are removed
//
// Killed at any moment, the target is absent, or complete, or as it was. With `resume` the next
// bake of the same source and settings goes on behind the last finished bucket.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "src/bundle/bundle.h"
#include "src/scene/triangle_stream.h"

namespace trex {

struct StreamBakeOptions {
  std::uint64_t maxMemory = 0;  ///< of the process, bytes
  int precisionBits = 24;
  int voxelDepth = 8;  ///< 0: no voxels
  bool resume = false;
  std::optional<Environment> environment;   ///< instead of the stream's
  std::optional<std::uint32_t> maxBounces;  ///< Scene::maxBounces instead of the stream's
  std::vector<Medium> media;                ///< besides the stream's
  /// Called now and then with a name and a share of what is under way; false stops the bake with
  /// Error(kInterrupted), keeping what was done for `resume`.
  std::function<bool(const char*, double)> keepGoing = [](const char*, double) { return true; };
};

/// What a streaming bake will need, bytes and seconds.
struct StreamEstimate {
  std::uint64_t memory = 0, allowed = 0;
  std::uint64_t spillBytes = 0, bundleBytes = 0, freeBytes = 0;  ///< on the target's disk
  double seconds = 0.0;
};

/// Estimates, without doing anything. Throws Error(kMemoryOrDevice), with the figures, if it can't
/// fit in memory or on disk.
StreamEstimate estimateStreamBake(const TriangleStream& stream, const StreamBakeOptions& options,
                                  const std::filesystem::path& target);

struct StreamBakeResult {
  std::vector<bundle::Section> sections;
  std::uint64_t triangles = 0, droppedTriangles = 0, replacedParts = 0, pages = 0, clusters = 0;
  std::uint64_t bucketsReused = 0, buckets = 0;
  int voxelDepth = 0;
  double spillSeconds = 0.0, meshSeconds = 0.0, voxelSeconds = 0.0;
};

/// Bakes. Frees the stream once it is read. Throws Error: kOutput for a full disk, naming the file,
/// after removing the temporaries.
StreamBakeResult bakeStream(std::unique_ptr<TriangleStream> stream,
                            const StreamBakeOptions& options, const BakeFacts& facts,
                            const std::filesystem::path& target);

/// Files that streaming bakes of a target keep beside it.
std::vector<std::filesystem::path> streamBakeFiles(const std::filesystem::path& target);

}  // namespace trex
