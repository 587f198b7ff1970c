// The texels that a shining triangle shows. Of emitters.cpp alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "src/core/maths.h"
#include "src/crays/ray_scene.h"
#include "src/scene/scene.h"
#include "src/scene/texture.h"

namespace trex {

/// A triangle on a texture, its corners in texels; `along`: its longest edge, 0: there is none.
struct Footprint {
  vec2 corner[3] = {};
  float along = 0.0f;
};

inline Footprint footprintOf(const Scene& scene, const Texture& texture,
                             const Surface (&corner)[3]) {
  Footprint out;
  if (!texture.present()) return out;
  const Image& image = scene.images[static_cast<std::size_t>(texture.image)];
  const vec2 size(static_cast<float>(image.width), static_cast<float>(image.height));
  vec2(&p)[3] = out.corner;
  for (int i = 0; i < 3; ++i) p[i] = transformUv(texture, corner[i].texCoords[texture.set]) * size;
  out.along =
      std::max({glm::length(p[1] - p[0]), glm::length(p[2] - p[1]), glm::length(p[0] - p[2])});
  return out;
}

inline double texelArea(const Footprint& f) {
  const glm::dvec2 a(f.corner[1] - f.corner[0]), b(f.corner[2] - f.corner[0]);
  return 0.5 * std::abs(a.x * b.y - a.y * b.x);
}

/// Whether its texels are few enough to be looked at one by one, and can be told apart by floats.
inline bool hasFewTexels(const Footprint& f, std::uint64_t most) {
  for (const vec2& corner : f.corner) {
    if (!(glm::length(corner) < 1e7f)) return false;
  }
  return texelArea(f) + 4.0 * static_cast<double>(f.along) < static_cast<double>(most);
}

/// What a step of one texel adds to the weights of the second and third corner.
struct TexelSteps {
  glm::dvec2 column, row;
  explicit TexelSteps(const Footprint& f) {
    const glm::dvec2 a(f.corner[1] - f.corner[0]), b(f.corner[2] - f.corner[0]);
    const double cross = a.x * b.y - a.y * b.x;
    column = glm::dvec2(b.y, -a.y) / cross;
    row = glm::dvec2(-b.x, a.x) / cross;
  }
};

/// Calls `take` with the weights of the second and third corner of the centre of each texel that
/// look-ups of the triangle may read: those inside, and those beside its edges.
template <typename Take>
void forTexels(const Footprint& f, const Take& take) {
  using Point = glm::dvec2;
  const Point origin(f.corner[0]);
  const Point a = Point(f.corner[1]) - origin, b = Point(f.corner[2]) - origin;
  const double cross = a.x * b.y - a.y * b.x;
  const double low = std::min({0.0, a.y, b.y}), high = std::max({0.0, a.y, b.y});
  const std::pair<Point, Point> edges[] = {{Point(0.0), a}, {a, b}, {b, Point(0.0)}};
  const double lastRow = std::floor(origin.y + high + 0.5);
  for (double row = std::floor(origin.y + low - 0.5); row <= lastRow; row += 1.0) {
    const double y = row + 0.5 - origin.y;
    const double within = std::clamp(y, low, high);  // a row beside it: as its first or last
    double first = kInfinity, last = -kInfinity;
    for (const auto& [from, to] : edges) {
      if (within < std::min(from.y, to.y) || within > std::max(from.y, to.y)) continue;
      if (to.y == from.y) {
        first = std::min({first, from.x, to.x});
        last = std::max({last, from.x, to.x});
        continue;
      }
      const double x = from.x + (to.x - from.x) * (within - from.y) / (to.y - from.y);
      first = std::min(first, x);
      last = std::max(last, x);
    }
    const double lastColumn = std::floor(origin.x + last + 0.5);
    for (double column = std::floor(origin.x + first - 0.5); column <= lastColumn; column += 1.0) {
      const double x = column + 0.5 - origin.x;
      take(Point((x * b.y - y * b.x) / cross, (a.x * y - a.y * x) / cross));
    }
  }
}

}  // namespace trex
