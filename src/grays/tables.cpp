#include "src/grays/tables.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>

#include "asvo/tracer.h"

namespace trex {
namespace {

/// Where entry (x, y, z) of a level stands in the grid.
std::size_t entryOf(std::uint32_t level, std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  return (std::size_t{1} << (3 * level)) + x + (std::size_t{y} << level) +
         (std::size_t{z} << (2 * level));
}

/// Voxels of one level of the grid; empty entries without their cubes.
void fillVoxels(const asvo::Tree& tree, std::uint32_t level, bool finest,
                std::vector<std::uint32_t>& grid) {
  const asvo::Tracer tracer(tree);
  const std::uint32_t cells = 1u << level;
  std::size_t entry = entryOf(level, 0, 0, 0);
  for (std::uint32_t z = 0; z < cells; ++z) {
    for (std::uint32_t y = 0; y < cells; ++y) {
      for (std::uint32_t x = 0; x < cells; ++x, ++entry) {
        const std::uint32_t parent = grid[entryOf(level - 1, x >> 1, y >> 1, z >> 1)];
        if (parent >= asvo::ASVO_GRID_EMPTY) continue;
        const asvo::uvec2 node = tree.nodes[parent & (asvo::ASVO_GRID_UNEVEN - 1u)];
        const std::uint32_t octant = (x & 1u) | (y & 1u) << 1 | (z & 1u) << 2;
        if ((node.y >> octant & 1u) == 0) continue;
        const std::uint32_t below = node.y & ((1u << octant) - 1u);
        const std::uint32_t child = node.x + static_cast<std::uint32_t>(std::popcount(below));
        const bool uneven = !finest && tracer.asvoUneven(child);
        grid[entry] = child | (uneven ? asvo::ASVO_GRID_UNEVEN : 0u);
      }
    }
  }
}

/// Edges of the empty cubes of one level in the direction of one octant, one less; from the far
/// corner back: a cube is one larger than the smallest of its seven neighbours ahead.
std::vector<std::uint8_t> emptyCubes(std::span<const std::uint32_t> grid, std::uint32_t level,
                                     int octant) {
  constexpr std::uint8_t kLargest = 8;
  const int cells = 1 << level, wide = cells + 1;
  // A layer of places beyond the far faces, where nothing is.
  std::vector<std::uint8_t> cubes(static_cast<std::size_t>(wide) * wide * wide, kLargest);
  const auto at = [&](int x, int y, int z) { return x + wide * (y + wide * z); };
  const auto place = [&](int i, int axis) {
    return static_cast<std::uint32_t>((octant >> axis & 1) != 0 ? cells - 1 - i : i);
  };
  for (int z = cells - 1; z >= 0; --z) {
    for (int y = cells - 1; y >= 0; --y) {
      std::uint8_t* row = &cubes[static_cast<std::size_t>(at(0, y, z))];
      const std::uint8_t *a = row + wide, *b = row + wide * wide, *c = b + wide;
      const std::uint32_t* entries = &grid[entryOf(level, 0, place(y, 1), place(z, 2))];
      for (int x = cells - 1; x >= 0; --x) {
        const std::uint8_t near = std::min(std::min(a[x], b[x]), c[x]);
        const std::uint8_t far = std::min(std::min(a[x + 1], b[x + 1]), c[x + 1]);
        const auto least = std::min<int>(std::min(near, far), row[x + 1]);
        const bool empty = entries[place(x, 0)] >= asvo::ASVO_GRID_EMPTY;
        row[x] = static_cast<std::uint8_t>(empty ? std::min(least + 1, int{kLargest}) : 0);
      }
    }
  }
  return cubes;
}

/// Writes the cubes of all octants into the empty entries of one level.
void fillCubes(std::uint32_t level, std::vector<std::uint32_t>& grid) {
  std::vector<std::uint8_t> cubes[8];
  tbb::parallel_for(0, 8, [&](int octant) { cubes[octant] = emptyCubes(grid, level, octant); });
  const std::size_t cells = std::size_t{1} << level, wide = cells + 1;
  tbb::parallel_for(std::size_t{0}, cells, [&](std::size_t z) {
    for (std::size_t y = 0; y < cells; ++y) {
      for (std::size_t x = 0; x < cells; ++x) {
        std::uint32_t& entry = grid[(cells * cells * cells) + x + (y << level) + (z << 2 * level)];
        if (entry < asvo::ASVO_GRID_EMPTY) continue;
        for (std::uint32_t octant = 0; octant < 8; ++octant) {
          const std::size_t i = (octant & 1u) != 0 ? cells - 1 - x : x;
          const std::size_t j = (octant & 2u) != 0 ? cells - 1 - y : y;
          const std::size_t k = (octant & 4u) != 0 ? cells - 1 - z : z;
          const std::uint32_t edge = cubes[octant][i + wide * (j + wide * k)];
          entry |= (edge - 1u) << (3 * octant);
        }
      }
    }
  });
}

template <typename Function>
void forNodes(std::size_t count, const Function& function) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i) function(i);
  });
}

const asvo::Tracer& packer() {
  static const asvo::Tree empty;
  static const asvo::Tracer tracer(empty);
  return tracer;
}

}  // namespace

std::uint32_t firstBrick(const asvo::Tree& tree) {
  return tree.levelOffsets[photonGridLevel(tree.info)];
}

std::uint32_t brickCount(const asvo::Tree& tree) { return tree.info.firstLeaf - firstBrick(tree); }

std::vector<std::uint32_t> makeGrid(const asvo::Tree& tree, std::uint32_t last) {
  std::vector<std::uint32_t> grid(std::size_t{2} << (3 * last), asvo::ASVO_GRID_EMPTY);
  grid[1] = 0;  // the root
  for (std::uint32_t level = 1; level <= last; ++level)
    fillVoxels(tree, level, level == last, grid);
  for (std::uint32_t level = 1; level <= last; ++level) fillCubes(level, grid);
  return grid;
}

asvo::uvec4 brickOf(const asvo::Tree& tree, std::uint32_t node) {
  const asvo::uvec2 links = tree.nodes[node];
  const bool leaves = links.x >= tree.info.firstLeaf;
  std::uint64_t mask = 0;
  std::uint32_t child = links.x;
  for (std::uint32_t octant = 0; octant < 8; ++octant) {
    if ((links.y >> octant & 1u) == 0) continue;
    const std::uint64_t below = leaves ? 0xffu : tree.nodes[child].y & 255u;
    mask |= below << (8 * octant);
    ++child;
  }
  const std::uint32_t grandchild = leaves ? 0u : tree.nodes[links.x].x;
  return {static_cast<std::uint32_t>(mask), static_cast<std::uint32_t>(mask >> 32), links.x,
          grandchild};
}

std::vector<asvo::uvec4> makeBricks(const asvo::Tree& tree) {
  const std::uint32_t first = firstBrick(tree);
  std::vector<asvo::uvec4> bricks(brickCount(tree));
  forNodes(bricks.size(), [&](std::size_t i) {
    bricks[i] = brickOf(tree, first + static_cast<std::uint32_t>(i));
  });
  return bricks;
}

void ConeTable::refresh(std::span<const asvo::uvec4> light,
                        std::span<const shaderio::PhotonMaterial> materials) {
  const bool shaped = !words_.empty();
  words_.resize(tree_.nodes.size());
  forNodes(words_.size(), [&](std::size_t i) {
    const asvo::uvec4 voxel = tree_.voxels[i];
    if (!shaped) words_[i] = asvo::uvec4(packer().asvoConeShape(voxel), 0u, 0u);
    words_[i].y = (words_[i].y & ~asvo::ASVO_CONE_UNKNOWN) | packer().asvoConeMark(voxel);
    glm::vec3 reflectance = packer().asvoUnpackAlbedo(voxel.z);
    const std::uint32_t material = voxel.w & 65535u;
    if (material < materials.size()) {
      const shaderio::PhotonMaterial& m = materials[material];
      reflectance += m.metallic * packer().asvoUnpackAlbedo(m.baseColor);
    }
    reflectance = glm::min(reflectance, glm::vec3(1.0f));
    words_[i].z = packer().asvoConeLight(reflectance, light[i].z);
    words_[i].w = packer().asvoConeLight(reflectance, light[i].w);
  });
  stale_ = false;
}

}  // namespace trex
