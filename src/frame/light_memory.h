// Light that surfaces were seen in, kept in the world: after a turn of the camera the first picture
// knows what the last ones knew.
//
// A hash grid of cells some pixels wide and six directions of the normal, after [Binder, Fricke,
// Keller, SIGGRAPH Talks 2018]: a cell has the mean and the spread of the light of its last
// samples, without texture. It replaces nothing: a pixel's own samples are joined by as many as the
// cell's mean is worth, less what it may be wrong by, so it fades as they grow.
#pragma once

#include <cstdint>
#include <vector>

#include "src/frame/features.h"

namespace trex {

/// One thread at a time adds; reading is thread safe while nobody does.
class LightMemory {
 public:
  static constexpr std::uint32_t kCells = 1u << 20;
  static constexpr std::uint64_t kBytes = std::uint64_t{kCells} * 28;

  /// Light of a sample that shows `f`. What scatters none, and metal, whose light changes with the
  /// view, is not kept. Non-finite values must not occur.
  void add(const Feature& f, const vec3& light);
  /// Joins what is known of the light around a part's mean place to its samples. `dice`, [0, 1)^2:
  /// where around it. False if nothing is.
  bool join(FeaturePart& part, vec2 dice) const;
  /// All of it is forgotten.
  void clear();

 private:
  struct Cell {
    std::uint32_t key = 0;  ///< 0: empty
    float count = 0.0f;
    vec3 light{0.0f};
    float bright = 0.0f, spread = 0.0f;  ///< luminance: mean, and sum of squares off it
  };
  static_assert(sizeof(Cell) == 28);
  static int levelOf(float footprint);
  static std::uint64_t hashOf(const vec3& position, const vec3& normal, int level);
  const Cell* find(const vec3& position, const vec3& normal, int level) const;

  std::vector<Cell> cells_;
};

}  // namespace trex
