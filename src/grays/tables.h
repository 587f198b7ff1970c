// The tables that asvo_trace.h reads instead of the tree's nodes: fewer reads a step, the same
// answers. Private to src/grays; derived from the tree, never stored.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "asvo/asvo.h"
#include "src/grays/shaderio.h"

namespace trex {

/// Finest level in the grid of photons: above the leaves, at most 64^3 entries (2 MiB in all).
inline std::uint32_t photonGridLevel(const asvo::AsvoInfo& info) {
  return std::min(info.depth - 1, 6u);
}
/// Of cones: at most 128^3 entries (16 MiB in all); made when a cone first asks.
inline std::uint32_t coneGridLevel(const asvo::AsvoInfo& info) {
  return std::min(info.depth - 1, asvo::ASVO_MAX_GRID_LEVEL);
}

/// Node of the first brick, and how many there are: inner voxels from the level of the photons'
/// grid on.
std::uint32_t firstBrick(const asvo::Tree& tree);
std::uint32_t brickCount(const asvo::Tree& tree);

/// ASVO_GRID with levels up to `last`: 2 * 8^last entries. The tree must be valid and not empty.
/// Runs on the calling oneTBB arena.
std::vector<std::uint32_t> makeGrid(const asvo::Tree& tree, std::uint32_t last);

/// ASVO_BRICK less firstBrick(): brickCount() entries.
std::vector<asvo::uvec4> makeBricks(const asvo::Tree& tree);

/// ASVO_BRICK of one inner node of any level.
asvo::uvec4 brickOf(const asvo::Tree& tree, std::uint32_t node);

/// ASVO_CONE of every node: what cones read of voxels in one word of 16 bytes. Metals count as
/// diffuse with the reflectance of their material: a cone can't follow their mirrors, and without
/// it what they send on would be lost.
class ConeTable {
 public:
  explicit ConeTable(const asvo::Tree& tree) : tree_(tree) {}
  /// The irradiance or the voxels' colours have changed: the words are out of date.
  void lightChanged() { stale_ = true; }
  bool stale() const { return stale_; }
  /// Brings the words up to date with `light` (asvo_layout.h) and `materials`. Costs some
  /// milliseconds for 10^5 voxels, so it is left until a cone asks.
  void refresh(std::span<const asvo::uvec4> light,
               std::span<const shaderio::PhotonMaterial> materials);
  std::span<const asvo::uvec4> words() const { return words_; }

 private:
  const asvo::Tree& tree_;
  std::vector<asvo::uvec4> words_;  ///< none until a cone asks
  bool stale_ = true;
};

}  // namespace trex
