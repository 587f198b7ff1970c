// Tiles are the unit of work.
#pragma once

#include <cstdint>
#include <vector>

namespace trex {

struct Tile {
  std::uint32_t x, y, width, height;
};

/// Cuts a frame into tiles of at most size x size pixels, each inside the frame, ordered from the
/// centre outwards: first what the viewer looks at.
std::vector<Tile> makeTiles(std::uint32_t width, std::uint32_t height, std::uint32_t size);

}  // namespace trex
