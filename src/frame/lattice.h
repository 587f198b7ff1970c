// The order in which the pixels of a tile get their next sample: cells of an 8x8 lattice, so that
// after 1, 4, 16 and 64 of them every 8th, 4th, 2nd and each pixel has it, evenly spread.
#pragma once

#include <array>
#include <cstdint>

namespace trex::lattice {

inline constexpr std::uint32_t kSide = 8, kCells = kSide * kSide;

/// Place of cell number `cell`, [0, 64), in the lattice: bits of the cell from the lowest up are
/// bits of the place from the highest down.
struct Place {
  std::uint32_t x, y;
};
constexpr Place placeOf(std::uint32_t cell) {
  Place p{0, 0};
  for (std::uint32_t bit = 0; bit < 3; ++bit) {
    const std::uint32_t pair = (cell >> (2 * bit)) & 3u;
    // 0, 1, 2, 3: the corner, its opposite, and the two others, so that two make a quincunx.
    const std::uint32_t x = pair == 1 || pair == 2, y = pair == 1 || pair == 3;
    p.x |= x << (2 - bit);
    p.y |= y << (2 - bit);
  }
  return p;
}
inline constexpr std::array<Place, kCells> kPlaces = [] {
  std::array<Place, kCells> places{};
  for (std::uint32_t i = 0; i < kCells; ++i) places[i] = placeOf(i);
  return places;
}();

/// Number of the cell that a pixel lies in, of a lattice that starts at a multiple of kSide.
inline constexpr std::array<std::uint8_t, kCells> kCellsByPlace = [] {
  std::array<std::uint8_t, kCells> cells{};
  for (std::uint32_t i = 0; i < kCells; ++i) {
    cells[kPlaces[i].y * kSide + kPlaces[i].x] = static_cast<std::uint8_t>(i);
  }
  return cells;
}();
constexpr std::uint32_t cellAt(std::uint32_t x, std::uint32_t y) {
  return kCellsByPlace[y % kSide * kSide + x % kSide];
}

/// Spacing of the finest even lattice that the first `cells` cells fill: 8, 4, 2, 1; 0 for none.
constexpr std::uint32_t spacing(std::uint32_t cells) {
  return cells >= 64 ? 1 : cells >= 16 ? 2 : cells >= 4 ? 4 : cells >= 1 ? 8 : 0;
}

}  // namespace trex::lattice
