// How noisy the light of a region is, by its photons in eight lots. What light of some photons
// differs by from that of fewer is one draw of its noise, and in a room that is lit through a gap
// little more than one number, its brightness: such a draw says next to nothing about how large
// the noise is. Eight lots say it seven times over.
//
// Of each cell (coarse_cells.h) the power that has landed there is known by lots. A lot's share,
// less what it should have, is another draw of the noise that all of a cell's light has in common;
// what leaves have beyond that is told by two lights (LightCache::noisyIrradiance()).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "src/crays/coarse_cells.h"

namespace trex {

/// Immutable, so thread safe.
class PhotonLots {
 public:
  static constexpr std::uint32_t kLots = 8;
  /// Which lot a pixel asks: one for each 2 x 2 of them, four in 4 x 4.
  static std::uint32_t ofPixel(std::uint32_t x, std::uint32_t y) {
    return (x >> 1 & 3u) | (y >> 1 & 1u) << 2;
  }

  /// Nothing is known.
  PhotonLots() = default;
  /// A draw of the noise that the light of a place has in common with its cell, relative to the
  /// light: expectation 0.
  float noise(const vec3& position, std::uint32_t lot) const {
    return cells_.empty() ? 0.0f : at(position).noise[lot];
  }
  /// What a photon of the light before brought the cell on average, over what one of all does: at
  /// most how many times as many all are.
  float before(const vec3& position) const { return cells_.empty() ? 1.0f : at(position).before; }

 private:
  friend class LotSums;
  struct Cell {
    std::array<float, kLots> noise{};
    float before = 1.0f;
  };
  const Cell& at(const vec3& position) const { return cells_[rows_[places_.of(position)]]; }

  CoarseCells places_;
  std::vector<std::uint32_t> rows_;  ///< by cell; row 0 is of cells where nothing landed
  std::vector<Cell> cells_;
};

/// Photons as they land. Not thread safe; sums depend on their order.
class LotSums {
 public:
  /// Nothing is counted.
  LotSums() = default;
  explicit LotSums(const Box3f& bounds) : places_{bounds} { restart(); }
  bool counts() const { return !rows_.empty(); }
  /// `photon`: its number. `power`: of any unit, finite, not negative.
  void add(const vec3& position, std::uint64_t photon, float power);
  void restart();
  /// Of the first `photons`, all of which are there. The next call's light before is this one.
  PhotonLots settle(std::uint64_t photons);

 private:
  /// Photons of a lot that follow each other: those are stratified among themselves.
  static constexpr std::uint64_t kRun = 512;
  using Sums = std::array<double, PhotonLots::kLots>;

  CoarseCells places_;
  std::vector<std::uint32_t> rows_;
  std::vector<Sums> sums_;
  std::vector<double> before_;  ///< of a photon on average, when settled last; by row
  bool settled_ = false;        ///< before
};

}  // namespace trex
