// The depth to begin with. A leaf stands wherever a vertex lies, so cells with vertices tell that a
// depth has too many leaves long before they are built.
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>

#include "asvo/build_parts.h"

namespace asvo {
namespace {

constexpr int kFinest = 9;  ///< level of the cells that are looked at: 16 MiB, a bit each
/// Triangles looked at, evenly spread; more tell little about limits of a few million leaves.
constexpr std::uint64_t kSample = 2'000'000;

/// A bit for each cell of a level, in Morton order: those of a parent are a byte.
class Cells {
 public:
  explicit Cells(int level) : words_(((std::size_t{1} << (3 * level)) + 63) / 64) {}
  void set(std::uint32_t key) {
    std::atomic_ref<std::uint64_t> word(words_[key / 64]);
    const std::uint64_t bit = std::uint64_t{1} << key % 64;
    if ((word.load(std::memory_order_relaxed) & bit) == 0) {
      word.fetch_or(bit, std::memory_order_relaxed);
    }
  }
  std::uint64_t count() const {
    std::uint64_t sum = 0;
    for (const std::uint64_t word : words_) sum += static_cast<std::uint64_t>(std::popcount(word));
    return sum;
  }
  /// Of the level above.
  Cells parents(int level) const {
    Cells out(level);
    for (std::size_t i = 0; i < words_.size(); ++i) {
      for (std::size_t byte = 0; byte < 8; ++byte) {
        const std::size_t key = 8 * i + byte;
        if ((words_[i] >> (8 * byte) & 255u) != 0) {
          out.words_[key / 64] |= std::uint64_t{1} << key % 64;
        }
      }
    }
    return out;
  }

 private:
  std::vector<std::uint64_t> words_;
};

void mark(const Triangle& triangle, const Grid& grid, int level, Cells& cells) {
  const double perMetre = std::ldexp(1.0, level) / grid.size;
  for (const glm::vec3& p : triangle.position) {
    const glm::dvec3 cell = glm::floor((glm::dvec3(p) - grid.lower) * perMetre);
    if (cell == glm::clamp(cell, 0.0, std::ldexp(1.0, level) - 1.0)) {
      cells.set(mortonOf(glm::uvec3(cell)));
    }
  }
}

}  // namespace

int possibleDepth(const TriangleSource& source, const Grid& grid, std::uint64_t maxLeaves,
                  std::uint64_t maxBytes) {
  const std::uint64_t count = source.count();
  if (3 * count <= maxLeaves) return grid.depth;
  int level = std::min(grid.depth, kFinest);
  Cells cells(level);
  const std::uint64_t stride = (count + kSample - 1) / kSample;
  tbb::parallel_for(tbb::blocked_range<std::uint64_t>(0, count / stride, 4096),
                    [&](const auto& range) {
                      Triangle triangle;
                      for (std::uint64_t i = range.begin(); i < range.end(); ++i) {
                        // At random in each stride: parts of as many triangles would show one
                        // alone.
                        const std::uint64_t random = i * 0x9e3779b97f4a7c15ull >> 32;
                        source.get(i * stride + random % stride, triangle);
                        if (isBuildable(triangle)) mark(triangle, grid, level, cells);
                      }
                    });
  std::vector<std::uint64_t> counts(static_cast<std::size_t>(level) + 1);  // by level
  for (int l = level;; --l) {
    counts[static_cast<std::size_t>(l)] = cells.count();
    if (l == 0) break;
    cells = cells.parents(l - 1);
  }
  const auto fits = [&](int leafLevel) {
    const std::uint64_t leaves = counts[static_cast<std::size_t>(leafLevel)];
    std::uint64_t bytes = leaves * sizeof(uvec2);
    for (int l = 0; l <= leafLevel; ++l) {
      bytes += counts[static_cast<std::size_t>(l)] * kBytesPerNode;
    }
    return leaves <= maxLeaves && (maxBytes == 0 || bytes <= maxBytes);
  };
  if (fits(level)) return grid.depth;
  while (level > 1 && !fits(level)) --level;
  return level;
}

}  // namespace asvo
