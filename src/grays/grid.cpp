#include "src/grays/grid.h"

#include <bit>

namespace trex {

std::vector<std::uint32_t> makeGrid(const asvo::Tree& tree) {
  const std::uint32_t last = gridLevel(tree.info);
  std::vector<std::uint32_t> grid(std::size_t{2} << (3 * last), asvo::ASVO_GRID_EMPTY);
  grid[1] = 0;  // the root
  for (std::uint32_t level = 1; level <= last; ++level) {
    const std::uint32_t cells = 1u << level;
    std::size_t entry = std::size_t{1} << (3 * level);
    for (std::uint32_t z = 0; z < cells; ++z) {
      for (std::uint32_t y = 0; y < cells; ++y) {
        for (std::uint32_t x = 0; x < cells; ++x, ++entry) {
          const std::uint32_t up = level - 1;
          const std::uint32_t parent =
              grid[(1u << (3 * up)) + (x >> 1) + (y >> 1 << up) + (z >> 1 << (2 * up))];
          if (parent >= asvo::ASVO_GRID_EMPTY) {
            grid[entry] = parent;
            continue;
          }
          const asvo::uvec2 node = tree.nodes[parent];
          const std::uint32_t octant = (x & 1u) | (y & 1u) << 1 | (z & 1u) << 2;
          const std::uint32_t below = node.y & ((1u << octant) - 1u);
          grid[entry] = (node.y >> octant & 1u) == 0
                            ? asvo::ASVO_GRID_EMPTY + level
                            : node.x + static_cast<std::uint32_t>(std::popcount(below));
        }
      }
    }
  }
  return grid;
}

}  // namespace trex
