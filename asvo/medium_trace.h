// Rays through a medium, in its cell space (medium.h).
//
// Density along a ray is a cubic polynomial within a cell, so two points of Gauss and Legendre
// integrate it exactly: optical depths carry the rounding of floats and nothing else, whatever the
// density, and take time in proportion to the cells that are passed. Bricks are passed by a DDA
// [Amanatides and Woo 1987], those of one value in one step.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "asvo/medium.h"

namespace asvo {

/// A ray of cell space. Places are origin + t * direction; t is in metres if direction is in cells
/// a metre.
struct MediumRay {
  glm::vec3 origin{0.0f}, direction{0.0f};
};

/// Visits the cubes of edge `edge` in [0, count) that a ray passes in [t0, t1], from front to back:
/// visit(cube, enter, leave), until it returns false. `origin` is relative to the first cube.
template <typename Visit>
bool walkCubes(const MediumRay& ray, float edge, const glm::ivec3& count, float t0, float t1,
               Visit&& visit) {
  const glm::vec3 start = ray.origin + ray.direction * t0;
  glm::ivec3 cube, step;
  glm::vec3 next;
  for (int axis = 0; axis < 3; ++axis) {
    const float d = ray.direction[axis];
    const float most = static_cast<float>(count[axis] - 1);
    const float place = std::clamp(std::floor(start[axis] / edge), 0.0f, most);
    cube[axis] = static_cast<int>(place);
    step[axis] = d > 0.0f ? 1 : d < 0.0f ? -1 : 0;
    const float border = (place + (d > 0.0f ? 1.0f : 0.0f)) * edge;
    next[axis] =
        d != 0.0f ? (border - ray.origin[axis]) / d : std::numeric_limits<float>::infinity();
  }
  float enter = t0;
  while (true) {
    const int axis = next.x < next.y ? (next.x < next.z ? 0 : 2) : (next.y < next.z ? 1 : 2);
    const float leave = std::clamp(next[axis], enter, t1);
    if (leave > enter && !visit(cube, enter, leave)) return false;
    if (!(next[axis] < t1)) return true;
    enter = leave;
    cube[axis] += step[axis];
    if (cube[axis] < 0 || cube[axis] >= count[axis]) return true;
    const float border = static_cast<float>(cube[axis] + (step[axis] > 0 ? 1 : 0)) * edge;
    next[axis] = (border - ray.origin[axis]) / ray.direction[axis];
  }
}

/// The shared exponent format of asvo_layout.h: three times 9 bits and 5 bits of exponent.
inline glm::vec3 unpackRgb9e5(std::uint32_t word) {
  const auto scale = std::bit_cast<float>(((word >> 27) + 103u) << 23);  // 2^(e - 15 - 9)
  return glm::vec3(static_cast<float>(word & 511u), static_cast<float>(word >> 9 & 511u),
                   static_cast<float>(word >> 18 & 511u)) *
         scale;
}

/// What a stretch of a ray holds. Emission is seen from its start, through the stretch itself.
struct MediumStretch {
  float depth = 0.0f;        ///< integral of the density
  glm::vec3 emission{0.0f};  ///< integral of emission times transmittance
};

/// Follows rays through a medium whose density counts `density` times (its cells as metres).
class MediumTracer {
 public:
  /// Light that passes more than this optical depth is none: less than 1e-26 of it.
  static constexpr float kOpaque = 60.0f;

  MediumTracer(const Medium& medium, float density) : m_(medium), density_(density) {}

  /// visit(enter, leave, depth, emission) for every stretch of one cell or brick that is not empty,
  /// until it returns false: optical depth, and mean emission (not attenuated).
  template <typename Visit>
  void walk(const MediumRay& ray, float t0, float t1, Visit&& visit) const {
    if (m_.empty() || !(t1 > t0)) return;
    walkCubes(ray, float{Medium::kCells}, m_.size, t0, t1,
              [&](const glm::ivec3& at, float enter, float leave) {
                const std::uint32_t number = m_.index[indexOf(at)];
                if (number == Medium::kNone) return true;
                const Medium::Brick& brick = m_.bricks[number];
                if (brick.values == Medium::kNone) {
                  return visit(enter, leave, density_ * brick.largest * (leave - enter),
                               unpackRgb9e5(brick.emission) * m_.emissionScale);
                }
                return walkBrick(brick, at, ray, enter, leave, visit);
              });
  }
  /// Whether anything that is not empty lies in [t0, t1].
  bool meets(const MediumRay& ray, float t0, float t1) const {
    if (m_.empty() || !(t1 > t0)) return false;
    return !walkCubes(
        ray, float{Medium::kCells}, m_.size, t0, t1,
        [&](const glm::ivec3& at, float, float) { return m_.index[indexOf(at)] == Medium::kNone; });
  }
  /// Optical depth, exact up to kOpaque, and emission. Within a cell the emission is its mean over
  /// the ray's stretch, attenuated as if density were even there: the one approximation, of second
  /// order in a cell's optical depth, and none where emission follows density.
  MediumStretch through(const MediumRay& ray, float t0, float t1) const {
    MediumStretch sum;
    walk(ray, t0, t1, [&](float enter, float leave, float depth, const glm::vec3& emission) {
      if (m_.emits()) {
        sum.emission += emission * ((leave - enter) * std::exp(-sum.depth) * meanPassed(depth));
      }
      sum.depth += depth;
      return sum.depth < kOpaque;
    });
    return sum;
  }
  /// Where the optical depth from t0 reaches `depth`; t1 if it does not.
  float place(const MediumRay& ray, float t0, float t1, float depth) const {
    float found = t1, before = 0.0f;
    walk(ray, t0, t1, [&](float enter, float leave, float here, const glm::vec3&) {
      if (before + here < depth) {
        before += here;
        return true;
      }
      found = placeWithin(ray, enter, leave, depth - before, here);
      return false;
    });
    return found;
  }
  /// Mean of exp(-x) over x in [0, depth].
  static float meanPassed(float depth) {
    return depth < 1e-3f ? 1.0f - 0.5f * depth : -std::expm1(-depth) / depth;
  }
  /// Density and emission at a place of cell space.
  float densityAt(const glm::vec3& place) const {
    const glm::vec3 cell = glm::floor(place);
    const Medium::Brick* brick = brickAt(glm::ivec3(cell));
    if (brick == nullptr) return 0.0f;
    if (brick->values == Medium::kNone) return density_ * brick->largest;
    return density_ * cellOf(*brick, glm::ivec3(cell) & 7).at(place - cell);
  }

 private:
  /// The eight densities around a cell.
  struct Cell {
    float v[8];  ///< x * 4 + y * 2 + z
    float at(const glm::vec3& f) const {
      const float a = v[0] + f.z * (v[1] - v[0]), b = v[2] + f.z * (v[3] - v[2]);
      const float c = v[4] + f.z * (v[5] - v[4]), d = v[6] + f.z * (v[7] - v[6]);
      const float low = a + f.y * (b - a), high = c + f.y * (d - c);
      return low + f.x * (high - low);
    }
  };

  std::size_t indexOf(const glm::ivec3& at) const {
    return static_cast<std::size_t>(at.x) +
           static_cast<std::size_t>(m_.size.x) *
               (static_cast<std::size_t>(at.y) +
                static_cast<std::size_t>(m_.size.y) * static_cast<std::size_t>(at.z));
  }
  const Medium::Brick* brickAt(const glm::ivec3& cell) const {
    const glm::ivec3 at = cell >> 3;
    for (int axis = 0; axis < 3; ++axis) {
      if (at[axis] < 0 || at[axis] >= m_.size[axis]) return nullptr;
    }
    const std::uint32_t number = m_.index[indexOf(at)];
    return number == Medium::kNone ? nullptr : &m_.bricks[number];
  }
  static std::size_t valueOf(const Medium::Brick& brick, const glm::ivec3& cell) {
    return std::size_t{brick.values} * Medium::kBrickValues +
           static_cast<std::size_t>(cell.x * 81 + cell.y * 9 + cell.z);
  }
  Cell cellOf(const Medium::Brick& brick, const glm::ivec3& cell) const {
    const std::uint16_t* from = &m_.densities[valueOf(brick, cell)];
    const float scale = brick.largest * (1.0f / 65535.0f);
    Cell out;
    for (int corner = 0; corner < 8; ++corner) {
      out.v[corner] = scale * static_cast<float>(
                                  from[(corner >> 2) * 81 + (corner >> 1 & 1) * 9 + (corner & 1)]);
    }
    return out;
  }
  glm::vec3 emissionOf(const Medium::Brick& brick, const glm::ivec3& cell,
                       const glm::vec3& f) const {
    const std::uint32_t* from = &m_.emissions[valueOf(brick, cell)];
    glm::vec3 sum(0.0f);
    for (int corner = 0; corner < 8; ++corner) {
      const glm::ivec3 at(corner >> 2, corner >> 1 & 1, corner & 1);
      const glm::vec3 w = glm::mix(1.0f - f, f, glm::vec3(at));
      sum += unpackRgb9e5(from[at.x * 81 + at.y * 9 + at.z]) * (w.x * w.y * w.z);
    }
    return sum;
  }
  /// The two places within [enter, leave] that stand for a cubic.
  static glm::vec2 gauss(float enter, float leave) {
    constexpr float kHalf = 0.288675135f;  // 1 / (2 sqrt(3))
    const float middle = 0.5f * (enter + leave), half = kHalf * (leave - enter);
    return {middle - half, middle + half};
  }
  template <typename Visit>
  bool walkBrick(const Medium::Brick& brick, const glm::ivec3& at, const MediumRay& ray, float t0,
                 float t1, Visit& visit) const {
    const MediumRay local{ray.origin - glm::vec3(at * Medium::kCells), ray.direction};
    return walkCubes(local, 1.0f, glm::ivec3(Medium::kCells), t0, t1,
                     [&](const glm::ivec3& cell, float enter, float leave) {
                       const Cell values = cellOf(brick, cell);
                       const glm::vec2 t = gauss(enter, leave);
                       const glm::vec3 from = local.origin - glm::vec3(cell);
                       const glm::vec3 a = within(from + local.direction * t.x);
                       const glm::vec3 b = within(from + local.direction * t.y);
                       const float mean = 0.5f * (values.at(a) + values.at(b));
                       glm::vec3 emission(0.0f);
                       if (brick.emission != 0) {
                         emission = (0.5f * m_.emissionScale) *
                                    (emissionOf(brick, cell, a) + emissionOf(brick, cell, b));
                       }
                       if (mean <= 0.0f && brick.emission == 0) return true;
                       return visit(enter, leave, density_ * mean * (leave - enter), emission);
                     });
  }
  /// Rounding may put a place outside its cell by a hair, where densities would be negative.
  static glm::vec3 within(const glm::vec3& f) {
    return glm::clamp(f, glm::vec3(0.0f), glm::vec3(1.0f));
  }
  /// Bisection of a stretch of one cell, or of a brick of one value, of `whole` optical depth.
  float placeWithin(const MediumRay& ray, float enter, float leave, float depth,
                    float whole) const {
    constexpr int kHalvings = 20;
    const glm::vec3 middle = ray.origin + ray.direction * (0.5f * (enter + leave));
    const glm::ivec3 cell(glm::floor(middle));
    const Medium::Brick* brick = brickAt(cell);
    if (brick == nullptr || brick->values == Medium::kNone) {
      return enter + (leave - enter) * std::min(depth / whole, 1.0f);
    }
    const Cell values = cellOf(*brick, cell & 7);
    const glm::vec3 from = ray.origin - glm::vec3(cell);
    float low = enter, high = leave;
    for (int i = 0; i < kHalvings; ++i) {
      const float t = 0.5f * (low + high);
      const glm::vec2 at = gauss(enter, t);
      const float sum = values.at(within(from + ray.direction * at.x)) +
                        values.at(within(from + ray.direction * at.y));
      (0.5f * density_ * sum * (t - enter) < depth ? low : high) = t;
    }
    return 0.5f * (low + high);
  }

  const Medium& m_;
  float density_;
};

}  // namespace asvo
