#include "src/frame/tiles.h"

#include <algorithm>

namespace trex {

std::vector<Tile> makeTiles(std::uint32_t width, std::uint32_t height, std::uint32_t size) {
  std::vector<Tile> tiles;
  for (std::uint32_t y = 0; y < height; y += size) {
    for (std::uint32_t x = 0; x < width; x += size) {
      tiles.push_back({x, y, std::min(size, width - x), std::min(size, height - y)});
    }
  }
  const auto distanceToCentre = [&](const Tile& t) {
    const double dx = t.x + 0.5 * t.width - 0.5 * width;
    const double dy = t.y + 0.5 * t.height - 0.5 * height;
    return dx * dx + dy * dy;
  };
  std::stable_sort(tiles.begin(), tiles.end(), [&](const Tile& a, const Tile& b) {
    return distanceToCentre(a) < distanceToCentre(b);
  });
  return tiles;
}

}  // namespace trex
