// How often cached light had turned (been reflected or scattered) before it came to where it is
// cached, by place. Where Scene::maxBounces has an end, cached light is of photons that have turned
// at most maxBounces - 2 times: as often as a path may that reads it after one turn of its own. One
// that reads it after more may take less: the share of it that has turned less often.
//
// Shares are those of the power that landed in cells, a sixteenth of the scene wide. They are asked
// for the last few turns of many, whose light is nearly the same everywhere; paths that have few
// turns left go on by rays (PathTracer::mayEndAfter()).
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/maths.h"
#include "src/crays/coarse_cells.h"

namespace trex {

/// Immutable, so thread safe.
class TurnShares {
 public:
  /// All light is said to have turned seldom enough.
  TurnShares() = default;
  /// Of the light at a place what has turned at most `turns` times, [0, 1]. Where no photon has
  /// landed, that of all places.
  float at(const vec3& position, std::uint32_t turns) const;

 private:
  friend class TurnSums;
  CoarseCells places_;
  std::vector<std::uint32_t> rows_;  ///< by cell; row 0 is of all places
  std::vector<float> shares_;        ///< `turns_` a row
  std::uint32_t turns_ = 0;
};

/// Photons as they land. Not thread safe; sums depend on their order.
class TurnSums {
 public:
  /// Nothing is counted.
  TurnSums() = default;
  /// Of photons that land in `bounds` and have turned at most `most` times.
  TurnSums(const Box3f& bounds, std::uint32_t most);
  bool counts() const { return turns_ > 0; }
  /// `power`: of any unit, finite, not negative.
  void add(const vec3& position, std::uint32_t turns, float power);
  void restart();
  TurnShares shares() const;

 private:
  CoarseCells places_;
  std::vector<std::uint32_t> rows_;  ///< as TurnShares'
  std::vector<double> sums_;
  std::uint32_t turns_ = 0;
};

}  // namespace trex
