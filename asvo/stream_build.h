// Trees of triangles that do not fit in memory.
#pragma once

#include <functional>
#include <vector>

#include "asvo/asvo.h"

namespace asvo {

/// Triangles in blocks that are compact in space and can be read again and again, by several
/// threads at a time, with the same result. What shade() needs beside the triangle is found by its
/// shadeKey, an index into `extra` of the same reading.
class BlockSource {
 public:
  virtual ~BlockSource() = default;
  struct Reading {
    std::vector<Triangle> triangles;
    std::vector<glm::vec4> extra;
    void clear() { triangles.clear(), extra.clear(); }
  };
  virtual std::uint32_t blockCount() const = 0;
  /// A box that the block's triangles lie in, render space.
  virtual void bounds(std::uint32_t block, glm::vec3& lower, glm::vec3& upper) const = 0;
  virtual std::uint64_t triangles(std::uint32_t block) const = 0;
  /// Appends those triangles of a block whose bounds meet the box; shade keys count from the front
  /// of `out.extra`. May throw; that ends the build.
  virtual void read(std::uint32_t block, const glm::vec3& lower, const glm::vec3& upper,
                    Reading& out) const = 0;
  virtual Shade shade(const Triangle& triangle, const Reading& reading, float u, float v) const = 0;
};

struct StreamBuildOptions {
  BuildOptions tree;                                     ///< without a cube of its own
  std::uint64_t memoryBytes = std::uint64_t{256} << 20;  ///< for triangles at hand, all threads
  /// Asked after each part with the share that is done; false ends in std::runtime_error.
  std::function<bool(double)> keepGoing = [](double) { return true; };
};

/// Builds the tree from bounds alone first: cells of space are split until the blocks that meet one
/// hold few enough triangles; then each cell is built from these blocks as Tree::build() does. The
/// memory is that of the tree and `memoryBytes`, whatever the number of triangles. The same bits
/// for any number of threads and any memoryBytes. Uses the threads of the calling oneTBB arena.
/// Throws std::invalid_argument for options out of range.
Tree buildFromBlocks(const BlockSource& source, const StreamBuildOptions& options);

}  // namespace asvo
